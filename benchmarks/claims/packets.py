"""Whole captures by `puck`, beside xz that knows no more than bytes, and xz that knows the packets.

    python -m benchmarks.claims.packets [CAPTURE ...] [--rooms 8] [--turns 10]

Generated captures of a virtual VLP-16, each of another room, and captures by path. `xz, packets`
gets what `puck` knows of the packets' layout and nothing of what it learns: distances,
reflectivities, azimuths and times each by themselves, laser by laser, as differences of successive
firings, high bytes apart from low ones. Printed are sizes and processor times relative to `xz -9e`
of the file, and the size of `puck` relative to `xz, packets`.
"""

from __future__ import annotations

import argparse
import lzma
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from benchmarks.claims.scenes import ROOMS, report, scanned
from numpy.typing import NDArray

from puck import CodingOptions, compress
from puck.options import EFFORTS, Effort
from puck.recordings.packet_turns import find_packets
from puck.recordings.packets import PACKET, PACKET_BYTES
from puckbench.recordings.writing import write_pcap

PRESET = 9 | lzma.PRESET_EXTREME
LASERS = 16


def planes_of(values: NDArray[np.integer]) -> bytes:
    """Return differences along the first axis of whole numbers (n, ...), byte by byte.

    The numbers of each place of the other axes follow each other.
    """
    wide = values.reshape(len(values), -1).T
    steps = np.diff(wide, axis=1, prepend=0).astype(values.dtype)
    size = values.dtype.itemsize
    return np.ascontiguousarray(steps).view(np.uint8).reshape(-1, size).T.tobytes()


def packet_planes(data: NDArray[np.uint8]) -> bytes:
    """Return a capture's content rearranged, from which the capture could be restored."""
    places = find_packets(data)[:, None] + np.arange(PACKET_BYTES)
    packets = data[places].view(PACKET).reshape(-1)
    others = np.delete(data, places.reshape(-1))
    records = others[-(len(others) // len(packets)) * len(packets) :].reshape(len(packets), -1)
    head = others[: len(others) - records.size]
    blocks = packets["blocks"]
    returns = blocks["returns"].reshape(-1, LASERS)
    parts = (returns["distance"], blocks["azimuth"].reshape(-1), packets["time_us"], records)
    rest = (blocks["flag"], packets["mode"], packets["product"])
    reflectivities = np.ascontiguousarray(returns["reflectivity"].T)
    whole = [head.tobytes(), *map(planes_of, parts), *map(planes_of, rest)]
    return b"".join([*whole, reflectivities.tobytes()])


def timed(call: Callable[[], int]) -> tuple[int, float]:
    """Return the result of a call, and the processor time that it took."""
    start = time.process_time()
    result = call()
    return result, time.process_time() - start


def measured(path: Path) -> dict[str, float]:
    """Return sizes in bytes and processor times in s."""
    data = np.fromfile(path, np.uint8)

    def by_puck(effort: Effort) -> int:
        with TemporaryDirectory() as folder:
            return compress(path, Path(folder, "small"), CodingOptions(effort=effort)).compressed

    calls: dict[str, Callable[[], int]] = {
        "xz": lambda: len(lzma.compress(data.tobytes(), preset=PRESET)),
        "xz, packets": lambda: len(lzma.compress(packet_planes(data), preset=PRESET)),
        **{f"puck, {effort}": partial(by_puck, effort) for effort in EFFORTS},
    }
    found: dict[str, float] = {}
    for name, call in calls.items():
        found[name], found[f"{name}: seconds"] = timed(call)
    return found


def captures(rooms: int, turns: int, folder: Path) -> Iterator[Path]:
    for name in ROOMS[:rooms]:
        path = folder / f"{name}.pcap"
        write_pcap(path, scanned(name, "vlp16", turns, step_deg=0.2))
        yield path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="*", type=Path)
    parser.add_argument("--rooms", type=int, default=len(ROOMS))
    parser.add_argument("--turns", type=int, default=10)
    options = parser.parse_args()
    with TemporaryDirectory() as folder:
        made = list(captures(options.rooms, options.turns, Path(folder)))
        if made:
            measured(made[0])  # compiles
        for title, paths in (("generated rooms", made), ("recordings", options.captures)):
            if not paths:
                continue
            table = pd.DataFrame({path.stem: measured(path) for path in paths}).T
            print(f"\n{title}\n{table.round(3).to_string()}")
            names = [name for name in map(str, table) if not name.endswith("seconds")]
            sizes = {name: list(table[name] / table["xz"]) for name in names}
            report(f"{title}: bytes relative to xz -9e of the file", sizes)
            known = {name: list(table[name] / table["xz, packets"]) for name in names}
            report(f"{title}: bytes relative to xz -9e of the packets' parts", known)
            spent = {name: list(table[f"{name}: seconds"] / table["xz: seconds"]) for name in names}
            report(f"{title}: processor time relative to xz -9e of the file", spent)


if __name__ == "__main__":
    main()

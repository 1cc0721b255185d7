"""What one turn of a spinning sensor takes in every codec of clouds in metres, at every rate.

    python -m benchmarks.performance.recordings RECORDING... [--codecs NAME ...]

For the first whole turn of each recording, as it is recorded (of a sensor that gives two returns of
a beam, both), and of a virtual VLP-16 in a generated office: bits per return, all bytes counted,
and in brackets the error in mm, root mean square of the distances to the nearest point, the larger
of both directions (D1). `5 mm`: bits at an error of 5 mm, between rates in the logarithms of both.
`ms`: of encoding and of decoding at the finest rate, the processor's, least of three.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from puckbench.codecs.base import Codec
from puckbench.codecs.registry import codecs, open_codec
from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.datasets.recordings import Recordings
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.lidar import free_origin, load_sensor, open_error_model, open_sweep, scan
from puckbench.lidar.returns import Returns
from puckbench.lidar.scan_returns import returns_of_scan
from puckbench.metrics.tables.storage import ERROR_MM, bits_at_error
from puckbench.scenes.rooms import make_room

T = TypeVar("T")


def recorded(path: Path) -> Returns:
    """The first whole turn of a recording."""
    found = Recordings(path=str(path))
    returns = found.load(found.names()[0]).returns
    assert returns is not None
    return returns


def virtual() -> Returns:
    """A turn of a level VLP-16 at 10 Hz in an office."""
    mesh, sensor = make_room("office_1", seed=1), load_sensor("vlp16")
    options = {"rotation_hz": 10, "frames_per_second": 10, "duration_s": 0.1}
    sweep = open_sweep({"preset": "spin", "azimuth_step_deg": 0.2, **options})
    random = generator(1, "recordings benchmark")
    table = scan(mesh, sensor, sweep, open_error_model("vlp16", None), free_origin(mesh), random)
    return returns_of_scan(table).returns


def measured(codec: Codec, cloud: PointCloud) -> Iterator[tuple[str, float, float]]:
    """Rate, bits per return and error in mm; nothing where the codec refuses the returns."""
    for rate in codec.metric_rates:
        try:
            stream = codec.encode_cloud(cloud, rate)
        except InputError as why:
            print(f"{codec.name} {rate}: {why}")
            return
        decoded = codec.decode_cloud(stream).xyz
        yield rate, 8 * len(stream) / len(cloud.xyz), 1000 * rms_error(cloud.xyz, decoded)


def rms_error(one: Floats, other: Floats) -> float:
    """The larger of both directions' root mean square distances to the nearest point."""
    ways = (cKDTree(other).query(one)[0], cKDTree(one).query(other)[0])
    return float(max(np.sqrt(np.mean(way**2)) for way in ways))


def least_ms(call: Callable[[], T]) -> tuple[float, T]:
    """Processor time of a call, the least of three, and what it gives."""
    taken = []
    for _ in range(3):
        start = time.process_time()
        given = call()
        taken.append(1000 * (time.process_time() - start))
    return min(taken), given


def rates_of(chosen: list[Codec]) -> list[str]:
    """The rates of all codecs, the longest first."""
    every = {rate for codec in chosen for rate in codec.metric_rates}
    return sorted(every, key=lambda rate: -float(rate.removesuffix("mm")))


def row(codec: Codec, cloud: PointCloud, rates: list[str]) -> str | None:
    """A row of the table; None where the codec refuses the returns."""
    found = list(measured(codec, cloud))
    if not found:
        return None
    cells = {rate: f"{bits:.2f} ({error:.1f})" for rate, bits, error in found}
    finest = list(codec.metric_rates)[-1]
    encode, stream = least_ms(lambda: codec.encode_cloud(cloud, finest))
    decode, _ = least_ms(lambda: codec.decode_cloud(stream))
    lossy = [(bits, error) for _, bits, error in found if error > 1e-3]
    known = pd.DataFrame(lossy, columns=["bits", "error"])
    at_error = bits_at_error(known["bits"], known["error"], ERROR_MM)
    bits_there = "" if np.isnan(at_error) else f"{at_error:.2f}"
    texts = [codec.name, *(cells.get(rate, "") for rate in rates), bits_there]
    return f"| {' | '.join(texts)} | {encode:.0f}, {decode:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="*")
    here = [name for name, own in codecs().items() if own.metric_rates]
    here = [name for name in here if open_codec(name).available().ok]
    parser.add_argument("--codecs", nargs="+", default=here)
    options = parser.parse_args()
    chosen = [open_codec(name) for name in options.codecs]
    rates = rates_of(chosen)
    for codec in chosen:
        codec.load()
    turns = {path.name: recorded(path) for path in options.recordings} | {"virtual": virtual()}
    for name, returns in turns.items():
        print(f"\n{name}: {len(returns)} returns of a {returns.sensor}\n")
        print(f"| | {' | '.join(rates)} | 5 mm | ms |\n|{'---|' * (len(rates) + 3)}")
        cloud = PointCloud(returns.points(), returns=returns)
        for found in filter(None, (row(codec, cloud, rates) for codec in chosen)):
            print(found, flush=True)


if __name__ == "__main__":
    main()

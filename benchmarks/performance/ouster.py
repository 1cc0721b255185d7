"""Recordings of Ouster sensors: `.puck` beside OSF, Ouster's own format.

    python -m benchmarks.performance.ouster CAPTURE... [--repeats 3]

A CAPTURE is a .pcap with the sensor's metadata beside it (`puckbench data ouster_recordings`). OSF
is written by the Ouster SDK (`pip install ouster-sdk`, version 1.0 or newer) at its default level
and at its highest, from the frames that the SDK reads from the same packets; that its fields come
back is checked. A `.puck` restores the capture byte by byte; OSF keeps the frames' fields, times
and the metadata, not the packets. Seconds are of the processor, all threads, the least of the
repeats; they include reading and writing files, and for OSF exclude decoding the packets.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from benchmarks.performance.rows import Inputs, MissingProgramError, Row, least_seconds

from puck import CodingOptions, compress, decompress
from puck.options import EFFORTS
from puck.recordings.ouster import metadata_beside

LEVELS = {"OSF, level 1": 1, "OSF, level 9": 9}


def frames_of(source: Any) -> list[Any]:
    return [frame for frames in source for frame in frames if frame is not None]


def osf_costs(capture: Path, level: int, repeats: int) -> tuple[int, float, float]:
    """Return the bytes of a capture as OSF, and the seconds of writing and reading it."""
    from ouster.sdk import open_source, osf

    source = open_source(str(capture))
    sets, info = list(source), source.sensor_info
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.osf")

        def write() -> None:
            path.unlink(missing_ok=True)
            encoder = osf.Encoder(osf.ZPngLidarFrameEncoder(level))
            writer = osf.Writer(str(path), info, [], 0, encoder)
            for frames in sets:
                writer.save(frames)
            writer.close()

        def read() -> list[Any]:
            return frames_of(osf.OsfFrameSetSource(str(path)))

        writing = least_seconds(write, repeats)
        for before, after in zip(frames_of(sets), read(), strict=True):
            assert all(np.array_equal(before.field(n), after.field(n)) for n in before.fields)
        return path.stat().st_size, writing, least_seconds(read, repeats)


def of_capture(capture: Path, repeats: int) -> Iterator[Row]:
    rivals = {name: osf_costs(capture, level, repeats) for name, level in LEVELS.items()}
    with TemporaryDirectory() as folder:
        small, back = Path(folder, "small"), Path(folder, "back")
        for effort in EFFORTS:
            options = CodingOptions(effort=effort)
            compress(capture, small, options)  # compiles
            encoding = least_seconds(lambda o=options: compress(capture, small, o), repeats)  # type: ignore[misc]
            decoding = least_seconds(lambda: decompress(small, back), repeats)
            assert back.read_bytes() == capture.read_bytes()
            for name, (size, writing, reading) in rivals.items():
                what = f"{capture.stem}, {effort}"
                yield Row(f"{what}: file", small.stat().st_size, "bytes", name, size)
                for action, ours, theirs in (
                    ("compress", encoding, writing),
                    ("decompress", decoding, reading),
                ):
                    label = f"{what}: {action}"
                    yield Row(label, ours, "processor s", name, theirs, repeats=repeats)


def of_captures(captures: Sequence[Path], repeats: int) -> Iterator[Row]:
    """Measure the captures of Ouster sensors among those given.

    Raises
    ------
    MissingProgramError
        There are none, or the Ouster SDK is not installed.
    """
    found = [path for path in captures if metadata_beside(path) is not None]
    if not found:
        raise MissingProgramError("needs captures (puckbench data ouster_recordings)")
    if find_spec("ouster") is None:
        raise MissingProgramError("needs the Ouster SDK (pip install ouster-sdk)")
    for path in found:
        yield from of_capture(path, repeats)


def measure(inputs: Inputs) -> Iterator[Row]:
    """Captures of Ouster sensors as whole files, where the Ouster SDK is installed."""
    yield from of_captures(inputs.recordings, inputs.repeats(3))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", type=Path, nargs="+")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    try:
        for row in of_captures(options.captures, options.repeats):
            print(row, flush=True)
    except MissingProgramError as error:
        print(f"left out: {error}")


if __name__ == "__main__":
    main()

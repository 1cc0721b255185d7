"""Bits, speed and error of the codec of returns on recordings, all bytes counted.

    python -m benchmarks.performance.puck RECORDING... [--repeats 3]

For each recording (packet capture or ROS bag) and each effort: bits per return of the ranges,
lasers and azimuths, exact; of two returns the strongest. `alone`: the mean of the whole turns, each
coded as a key turn. Seconds are the processor's, the least of the repeats; the factor of real time
is the time that the packets' clock ran through, over them. Then whole files: the size by
`compress`, and its ratio to that by `xz -9e`. Then one file of ten recordings: processor time
relative to that of `xz -9e` in the same run.

An Ouster's capture, with the sensor's metadata beside it, is measured as a whole file alone; its
real time is that of turns at 10 Hz. Processor time adds up the time of all threads.
"""

from __future__ import annotations

import argparse
import lzma
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.clouds import write_recording
from benchmarks.performance.rows import Inputs, Row, least_seconds

from pointkit.lidar.turns import Layout, Turn
from puck import CodingOptions, compress, decode_turns, decompress, encode_turns
from puck.options import EFFORTS
from puck.recordings.ouster import metadata_beside
from puck.recordings.packet_turns import find_packets, split_turns, turn_of
from puck.recordings.packets import PACKET, PACKET_BYTES
from puckbench.recordings.reading import read_packets

OUSTER_HERTZ = 10.0


def strongest(path: Path) -> tuple[Layout, list[Turn], float]:
    """Return the layout, the turns (strongest returns alone) and the seconds of a recording."""
    payloads = read_packets(path).payloads
    parts = list(split_turns(payloads))
    kind = parts[0][0]
    turns = [turn_of(one, part) for one, part in parts]
    seconds = np.concatenate([turn.times for turn in turns]).astype(np.int64)
    whole = float((seconds[-1] - seconds[0]) * len(seconds) / (len(seconds) - 1) / 1e6)
    layout = Layout(kind.layout.order, kind.layout.columns_per_block, kind.layout.blocks_per_time)
    bare = [Turn(turn.ranges[:1], turn.azimuths) for turn in turns]
    return layout, bare, whole


def lossless(
    name: str, layout: Layout, turns: list[Turn], seconds: float, repeats: int
) -> Iterator[Row]:
    returns = sum(turn.returns for turn in turns)
    longest = max(len(turn.azimuths) for turn in turns)
    whole = [turn for turn in turns if len(turn.azimuths) > 0.9 * longest]
    for effort in EFFORTS:
        options, best = CodingOptions(effort=effort), [np.inf, np.inf]
        for _ in range(repeats + 1):  # the first compiles
            start = time.process_time()
            stream = encode_turns(turns, layout, options)
            middle = time.process_time()
            found = decode_turns(stream)
            end = time.process_time()
            best = [min(best[0], middle - start), min(best[1], end - middle)]
        assert all(np.array_equal(a.ranges, b.ranges) for a, b in zip(turns, found, strict=True))
        alone = [8 * len(encode_turns([turn], layout, options)) / turn.returns for turn in whole]
        what = f"{name}, {effort}"
        yield Row(f"{what}: turns", 8 * len(stream) / returns, "bits per return")
        yield Row(f"{what}: key turns alone", float(np.mean(alone)), "bits per return")
        for action, least in zip(("encode", "decode"), best, strict=True):
            speed = seconds / least
            yield Row(f"{what}: {action} turns", speed, "x real time", at_least=1, repeats=repeats)


def files(path: Path, seconds: float | None, repeats: int) -> Iterator[Row]:
    xz = len(lzma.compress(path.read_bytes(), preset=9 | lzma.PRESET_EXTREME))
    with TemporaryDirectory() as folder:
        small, back = Path(folder, "small"), Path(folder, "back")
        for effort in EFFORTS:
            best = [np.inf, np.inf]
            for _ in range(repeats + 1):  # the first compiles
                start = time.process_time()
                account = compress(path, small, CodingOptions(effort=effort))
                middle = time.process_time()
                decompress(small, back)
                best = [min(best[0], middle - start), min(best[1], time.process_time() - middle)]
            assert back.read_bytes() == path.read_bytes()
            what = f"{path.name}, {effort}"
            yield Row(f"{what}: file", account.compressed, "bytes", "xz -9e", xz, at_most=1)
            recorded = account.turns / OUSTER_HERTZ if seconds is None else seconds
            for action, least in zip(("compress", "decompress"), best, strict=True):
                yield Row(f"{what}: {action}", recorded / least, "x real time", repeats=repeats)


def of_recordings(paths: Sequence[Path], repeats: int) -> Iterator[Row]:
    """Measure turns of Velodynes, whole files, and one file of ten recordings of Velodynes."""
    velodynes = [path for path in paths if metadata_beside(path) is None]
    for path in paths:
        seconds = None
        if path in velodynes:
            layout, turns, seconds = strongest(path)
            yield from lossless(path.name, layout, turns, seconds, repeats)
        yield from files(path, seconds, repeats)
    if velodynes:
        yield from ten_in_one(velodynes, repeats)


def measure(inputs: Inputs) -> Iterator[Row]:
    """Turns of a virtual VLP-16 and of recordings, which are also compressed as whole files."""
    with TemporaryDirectory() as folder:
        made = write_recording(Path(folder, "virtual VLP-16"), 1 if inputs.is_trial else 10)
        yield from lossless(made.name, *strongest(made), inputs.repeats(3))
    yield from of_recordings(inputs.recordings, inputs.repeats(3))


def another(path: Path, random: np.random.Generator) -> bytes:
    """Return a recording with each range changed by -1, 0 or 1 quantum.

    So `xz` finds few repetitions, and takes as long as for another recording.
    """
    data = np.fromfile(path, np.uint8)
    bytes_of_packets = find_packets(data)[:, None] + np.arange(PACKET_BYTES)
    packets = data[bytes_of_packets].view(PACKET)
    ranges = packets["blocks"]["returns"]["distance"]
    ranges += ((ranges > 1) * random.integers(-1, 2, ranges.shape)).astype(np.uint16)
    data[bytes_of_packets] = packets.view(np.uint8).reshape(-1, PACKET_BYTES)
    return data.tobytes()


def ten_in_one(paths: Sequence[Path], repeats: int) -> Iterator[Row]:
    random = np.random.default_rng(0)
    raw = b"".join(another(paths[k % len(paths)], random) for k in range(10))
    preset = 9 | lzma.PRESET_EXTREME
    whole = least_seconds(lambda: lzma.compress(raw, preset=preset), repeats)
    with TemporaryDirectory() as folder:
        one, small, restored = Path(folder, "one"), Path(folder, "small"), Path(folder, "restored")
        one.write_bytes(raw)
        for effort in EFFORTS:
            encode = partial(compress, one, small, CodingOptions(effort=effort))
            for action, call in (
                ("compress", encode),
                ("decompress", partial(decompress, small, restored)),
            ):
                what = f"ten recordings in one file, {effort}: {action}"
                least = least_seconds(call, repeats)
                yield Row(what, least, "processor s", "xz -9e", whole, repeats=repeats)
            assert restored.read_bytes() == raw


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    for row in of_recordings(options.recordings, options.repeats):
        print(row, flush=True)


if __name__ == "__main__":
    main()

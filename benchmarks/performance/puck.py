"""Bits, speed and error of the codec of returns on recordings, all bytes counted.

    python -m benchmarks.performance.puck RECORDING... [--repeats 3]

For each recording (packet capture or ROS bag) and each effort: bits per return of the ranges,
lasers and azimuths, exact; of two returns the strongest. `alone`: the mean of the whole turns, each
coded as a key turn. Seconds are the processor's, the least of the repeats; the factor of real time
is the time that the packets' clock ran through, over them. Then whole files: the size by
`compress`, and its ratio to that by `xz -9e`. Then one file of ten recordings: processor time
relative to that of `xz -9e` in the same run. Last the wall clock of the commands on about 100 kB,
with the start of Python.
"""

from __future__ import annotations

import argparse
import lzma
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pointkit.lidar.turns import Layout, Turn
from puck import CodingOptions, compress, decode_turns, decompress, encode_turns
from puck.options import EFFORTS
from puck.recordings.packet_turns import find_packets, split_turns, turn_of
from puck.recordings.packets import PACKET, PACKET_BYTES
from puckbench.recordings.reading import read_packets


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


def lossless(name: str, layout: Layout, turns: list[Turn], seconds: float, repeats: int) -> None:
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
        print(
            f"{name:32} {effort:9} {8 * len(stream) / returns:.3f} bits, alone {np.mean(alone):.3f}"
            f" ({min(alone):.3f} to {max(alone):.3f}); {returns / best[0] / 1e3:.0f} and"
            f" {returns / best[1] / 1e3:.0f} thousand returns/s, {seconds / best[0]:.1f} and"
            f" {seconds / best[1]:.1f} times real time"
        )


def files(path: Path) -> None:
    xz = len(lzma.compress(path.read_bytes(), preset=9 | lzma.PRESET_EXTREME))
    with TemporaryDirectory() as folder:
        small, back = Path(folder, "small"), Path(folder, "back")
        for effort in EFFORTS:
            start = time.process_time()
            account = compress(path, small, CodingOptions(effort=effort))
            middle = time.process_time()
            decompress(small, back)
            seconds = middle - start, time.process_time() - middle
            assert back.read_bytes() == path.read_bytes()
            print(
                f"{path.name:32} {effort:9} {account.compressed} of {account.bytes} bytes,"
                f" {account.compressed / xz:.3f} of xz -9e; {seconds[0]:.2f} and {seconds[1]:.2f} s"
            )


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


def least_seconds(call: Callable[[], object], repeats: int) -> float:
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        seconds.append(time.process_time() - start)
    return min(seconds)


def ten_in_one(paths: list[Path], repeats: int) -> None:
    random = np.random.default_rng(0)
    raw = b"".join(another(paths[k % len(paths)], random) for k in range(10))
    preset = 9 | lzma.PRESET_EXTREME
    whole = least_seconds(lambda: lzma.compress(raw, preset=preset), repeats)
    print(f"ten recordings in one file: {len(raw)} bytes; xz -9e {whole:.2f} s")
    with TemporaryDirectory() as folder:
        one, small, restored = Path(folder, "one"), Path(folder, "small"), Path(folder, "restored")
        one.write_bytes(raw)
        for effort in EFFORTS:
            options = CodingOptions(effort=effort)
            encoding = least_seconds(partial(compress, one, small, options), repeats)
            decoding = least_seconds(partial(decompress, small, restored), repeats)
            assert restored.read_bytes() == raw
            print(
                f"{effort:9} compress {encoding / whole:.3f}, decompress {decoding / whole:.3f} of"
                f" the time of xz -9e ({encoding:.3f} and {decoding:.3f} s)"
            )


def start_up(path: Path, repeats: int) -> None:
    data = np.fromfile(path, np.uint8)
    places = find_packets(data)
    piece = data[: places[min(len(places), 80) - 1] + PACKET_BYTES].tobytes()
    with TemporaryDirectory() as folder:
        one, small = Path(folder, "one"), Path(folder, "small")
        one.write_bytes(piece)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        for program in ("puck", "puckbench"):
            medians = []
            for words in (["compress", one, small], ["decompress", small, Path(folder, "back")]):
                seconds = []
                for _ in range(repeats + 1):  # the first compiles
                    start = time.monotonic()
                    command = [sys.executable, "-m", program, *map(str, words)]
                    subprocess.run(command, check=True, capture_output=True, env=environment)
                    seconds.append(time.monotonic() - start)
                medians.append(np.median(seconds[1:]))
            print(
                f"python -m {program}, {len(piece)} bytes: compress {medians[0]:.2f} and decompress"
                f" {medians[1]:.2f} s (wall clock, medians of {repeats})"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    for path in options.recordings:
        layout, turns, seconds = strongest(path)
        lossless(path.name, layout, turns, seconds, options.repeats)
        files(path)
    ten_in_one(options.recordings, options.repeats)
    start_up(options.recordings[0], options.repeats)


if __name__ == "__main__":
    main()

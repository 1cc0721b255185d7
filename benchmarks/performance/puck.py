"""Bits, speed and error of the codec of returns on recordings, all bytes counted.

    python -m benchmarks.performance.puck RECORDING... [--repeats 3]

For each recording (packet capture or ROS bag) and each effort: bits per return of the ranges,
lasers and azimuths, exact; of two returns the strongest. `alone`: the mean of the whole turns, each
coded as a key turn. Seconds are the processor's, the least of the repeats; the factor of real time
is the time that the packets' clock ran through, over them. Then whole files: the size by
`compress`, and its ratio to that by `xz -9e`.

An Ouster's capture, with the sensor's metadata beside it, is measured as a whole file alone; its
real time is that of turns at 10 Hz. Processor time adds up the time of all threads.
"""

from __future__ import annotations

import argparse
import lzma
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pointkit.lidar.turns import Layout, Turn
from puck import CodingOptions, compress, decode_turns, decompress, encode_turns
from puck.options import EFFORTS
from puck.recordings.ouster import metadata_beside
from puck.recordings.packet_turns import split_turns, turn_of
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


def files(path: Path, seconds: float | None, repeats: int) -> None:
    xz = len(lzma.compress(path.read_bytes(), preset=9 | lzma.PRESET_EXTREME))
    with TemporaryDirectory() as folder:
        small, back = Path(folder, "small"), Path(folder, "back")
        for effort in EFFORTS:
            best = [np.inf, np.inf]
            for _ in range(repeats + 1):
                start = time.process_time()
                account = compress(path, small, CodingOptions(effort=effort))
                middle = time.process_time()
                decompress(small, back)
                end = time.process_time()
                best = [min(best[0], middle - start), min(best[1], end - middle)]
            assert back.read_bytes() == path.read_bytes()
            recorded = account.turns / OUSTER_HERTZ if seconds is None else seconds
            print(
                f"{path.name:32} {effort:9} {account.compressed} of {account.bytes} bytes,"
                f" {account.compressed / xz:.3f} of xz -9e; {best[0]:.3f} and {best[1]:.3f} s,"
                f" {recorded / best[0]:.2f} and {recorded / best[1]:.2f} times real time"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    for path in options.recordings:
        seconds = None
        if metadata_beside(path) is None:
            layout, turns, seconds = strongest(path)
            lossless(path.name, layout, turns, seconds, options.repeats)
        files(path, seconds, options.repeats)


if __name__ == "__main__":
    main()

"""Bits, speed and error of the codec of returns on recordings, all bytes counted.

    python -m benchmarks.performance.puck RECORDING... [--repeats 3] [--lossy]

For each recording (packet capture or ROS bag) and each effort: bits per return of the ranges,
lasers and azimuths, exact; of two returns the strongest. `alone`: the mean of the whole turns, each
coded as a key turn. Seconds are the processor's, the least of the repeats; the factor of real time
is the time that the packets' clock ran through, over them. Then whole files: the size by
`compress`, and its ratio to that by `xz -9e`. With --lossy, bits per return and errors by step and
lambda: D1 in mm^2 is the larger mean of the two directions, over the second and third turn.
"""

from __future__ import annotations

import argparse
import lzma
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from puckbench.lidar import load_sensor
from puckbench.lidar.recordings.packet_turns import SENSORS, split_turns, turn_of
from puckbench.lidar.recordings.reading import read_packets
from puckbench.lidar.turns import Layout, Turn
from puckbench.puck import CodingOptions, compress, decode_turns, decompress, encode_turns
from puckbench.puck.options import EFFORTS

QUANTUM_MM = 2.0
LOSSY = ((1, 0), (2, 0), (4, 0), (8, 0), (8, 6), (16, 0), (16, 24), (32, 0), (32, 96))


def strongest(path: Path) -> tuple[str, Layout, list[Turn], float]:
    """Sensor, layout and turns of a recording, the strongest returns alone, and its seconds."""
    payloads = read_packets(path).payloads
    parts = list(split_turns(payloads))
    kind = parts[0][0]
    turns = [turn_of(one, part) for one, part in parts]
    seconds = np.concatenate([turn.times for turn in turns]).astype(np.int64)
    whole = float((seconds[-1] - seconds[0]) * len(seconds) / (len(seconds) - 1) / 1e6)
    layout = Layout(kind.layout.order, kind.layout.columns_per_block, kind.layout.blocks_per_time)
    bare = [Turn(turn.ranges[:1], turn.azimuths) for turn in turns]
    return SENSORS[kind.product], layout, bare, whole


def lossless(name: str, layout: Layout, turns: list[Turn], seconds: float, repeats: int) -> None:
    """Print bits per return and speeds of each effort."""
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
    """Print the sizes of the whole file."""
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


def points(sensor: str, layout: Layout, turn: Turn, ranges: NDArray[np.uint16]) -> NDArray:
    """Points of a turn, mm."""
    device = load_sensor(sensor)
    azimuths = turn.azimuths.astype(float)
    rises = np.diff(azimuths) % 36000
    rises = np.append(rises, rises[-1:])
    within = np.arange(layout.columns_per_block) / layout.columns_per_block
    angle = np.radians((azimuths[:, None] + rises[:, None] * within) / 100).reshape(-1, 1)
    elevation = np.radians(device.laser_elevation_deg)
    correction = np.asarray(device.vertical_correction_mm or np.zeros(layout.lasers))
    distance = ranges[0] * QUANTUM_MM
    level = distance * np.cos(elevation)
    up = distance * np.sin(elevation) + correction
    return np.stack([level * np.sin(angle), level * np.cos(angle), up], axis=2)[distance > 0]


def d1(a: NDArray, b: NDArray) -> float:
    """Mean squared distance to the nearest point, the larger of both directions."""
    there, back = cKDTree(b).query(a)[0], cKDTree(a).query(b)[0]
    return float(max(np.mean(there**2), np.mean(back**2)))


def lossy(name: str, sensor: str, layout: Layout, turns: list[Turn]) -> None:
    """Print bits per return and errors by step and lambda."""
    returns = sum(turn.returns for turn in turns)
    for step, lmbda in LOSSY:
        stream = encode_turns(
            turns, layout, CodingOptions(step=step, lmbda=lmbda, effort="thorough")
        )
        found = decode_turns(stream)
        pairs = list(zip(turns, found, strict=True))
        wrong = np.concatenate(
            [(a.ranges.astype(float) - b.ranges)[a.ranges > 0] for a, b in pairs]
        )
        error = np.mean(
            [
                d1(points(sensor, layout, a, a.ranges), points(sensor, layout, a, b.ranges))
                for a, b in pairs[1:3]
            ]
        )
        print(
            f"{name:32} step {QUANTUM_MM * step:.0f} mm, lambda {lmbda:3}:"
            f" {8 * len(stream) / returns:.3f} bits, D1 {error:.2f} mm^2, rms"
            f" {QUANTUM_MM * np.sqrt(np.mean(wrong**2)):.2f} mm, largest"
            f" {QUANTUM_MM * np.abs(wrong).max():.0f} mm"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--lossy", action="store_true")
    options = parser.parse_args()
    for path in options.recordings:
        sensor, layout, turns, seconds = strongest(path)
        lossless(path.name, layout, turns, seconds, options.repeats)
        files(path)
        if options.lossy:
            lossy(path.name, sensor, layout, turns)


if __name__ == "__main__":
    main()

"""Time of the octree's angular mode and of the reference software, side by side.

    python -m benchmarks.performance.gpcc_angular TMC3 [--repeats 3]

A turn of some 30,000 returns and twenty longer ones, 1,150,000, of a level VLP-16 in a generated
office, with its errors, on a grid of millimetres; every point is coded. TMC3's seconds are those of
its whole process, and those that it prints, without its reading and writing of files; ours are of
arrays in memory, compiled before. The two take turns and the least of the repeats counts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from benchmarks.checks.gpcc_angular_crosscheck import COMMON, tmc3_options
from benchmarks.tmc3 import Reference
from benchmarks.turns import Turn, virtual_turn

from puckbench.gpcc.coder import decode_geometry, encode_geometry
from puckbench.gpcc.options import GpccOptions

COLUMNS = "| points | bytes, TMC3 / ours | | TMC3, process s | TMC3, printed s | ours s | ratio |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    print(f"{COLUMNS}\n|{'---|' * 7}")
    for turns, step_deg in ((1, 0.192), (20, 0.1)):
        row(options.tmc3, virtual_turn("vlp16", "vlp16", turns, step_deg), options.repeats)


def row(tmc3: str, turn: Turn, repeats: int) -> None:
    """Two lines of the table: encoding and decoding of a cloud."""
    options = GpccOptions(**COMMON)
    encode_geometry(turn.points[:100], options, sensor=turn.sensor)
    least = np.full((2, 3), np.inf)
    points, words = turn.points.astype(np.float64), tmc3_options(options, turn.sensor)
    with tempfile.TemporaryDirectory() as at:
        reference = Reference(tmc3, Path(at))
        for _ in range(repeats):
            theirs = reference.encode(points, words)
            least[0, :2] = np.minimum(least[0, :2], seconds(reference))
            reference.decode(theirs)
            least[1, :2] = np.minimum(least[1, :2], seconds(reference))
            start = time.perf_counter()
            mine = encode_geometry(turn.points, options, sensor=turn.sensor)
            middle = time.perf_counter()
            decode_geometry(mine).positions()
            end = time.perf_counter()
            least[:, 2] = np.minimum(least[:, 2], [middle - start, end - middle])
    sizes = f"{len(theirs):,} / {len(mine):,}"
    for name, (process, printed, ours) in zip(("encode", "decode"), least.tolist(), strict=True):
        print(
            f"| {len(turn.points):,} | {sizes} | {name} | {process:.3f} | {printed:.3f} "
            f"| {ours:.3f} | {ours / process:.2f} |",
            flush=True,
        )


def seconds(reference: Reference) -> tuple[float, float]:
    """Seconds of the reference's last process, and those that it printed."""
    return reference.seconds, reference.printed_seconds("wall")


if __name__ == "__main__":
    main()

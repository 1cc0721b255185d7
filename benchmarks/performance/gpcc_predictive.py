"""Time and size of our predictive geometry and of the reference software's, side by side.

    python -m benchmarks.performance.gpcc_predictive TMC3 [--repeats 3] [--turns 20]

One turn of a virtual VLP-16 (28,800 points, mm) and twenty finer ones (1,152,000), with the sensor
and without. TMC3's seconds are those it prints, wall clock and user time, without its reading and
writing of files; ours are of arrays in memory, compiled before, wall clock and the processor's. The
two take turns and the least of the repeats counts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from benchmarks.checks.gpcc_predictive_crosscheck import tmc3_options
from benchmarks.tmc3 import Reference
from benchmarks.turns import Turn, virtual_turn

from puckbench.geometry.cloud import Floats
from puckbench.gpcc.coder import decode_geometry
from puckbench.gpcc.predictive_coder import PredictiveOptions, encode_predictive_geometry

MOST = 1 << 24
LEAST = 0.001
"""Seconds: TMC3 prints none less than 0."""
MODES = {
    "sensor": {},
    "sensor, radius 4": {"radius_inv_scale_log2": 4, "azimuth_scale_log2": 9, "base_qp": 58},
    "Morton": {"order": "morton"},
}
WHOLE = {"enforceLevelLimits": 0, "sliceMaxPoints": MOST, "positionSliceQpFreqLog2": 8}


def least(times: Floats, which: int, found: tuple[float, float]) -> None:
    times[which] = np.minimum(times[which], found)


def printed(reference: Reference) -> tuple[float, float]:
    """Wall clock and user time that TMC3 says it took."""
    return reference.printed_seconds("wall"), reference.printed_seconds("user")


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Wall clock and processor time of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - wall, time.process_time() - cpu


def row(reference: Reference, turn: Turn, mode: str, repeats: int) -> str:
    """One line of the table, the reference first, then ours and the ratio."""
    options = PredictiveOptions(**MODES[mode], tree_max_points=MOST, slice_max_points=MOST)
    sensor = turn.sensor if "sensor" in mode else None
    points, words = turn.points.astype(np.float64), {**tmc3_options(options, sensor), **WHOLE}
    mine = encode_predictive_geometry(turn.points, options, sensor=sensor)
    decode_geometry(mine)
    theirs, ours = np.full((2, 2, 2), np.inf)
    for _ in range(repeats):
        stream = reference.encode(points, words)
        least(theirs, 0, printed(reference))
        reference.decode(stream)
        least(theirs, 1, printed(reference))
        least(
            ours, 0, timed(lambda: encode_predictive_geometry(turn.points, options, sensor=sensor))
        )
        least(ours, 1, timed(lambda: decode_geometry(mine).positions()))
    pairs = zip(theirs.flat, ours.flat, strict=True)
    times = [f"{a:.3f} / {b:.3f} ({b / max(a, LEAST):.2f})" for a, b in pairs]
    sizes = f"{len(stream):,} / {len(mine):,}"
    return f"| {len(points):,} | {mode} | {sizes} | {' | '.join(times)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--turns", type=int, default=20)
    options = parser.parse_args()
    columns = ("points", "mode", "bytes", "encode, wall s", "encode, CPU s", "decode, wall s")
    print(f"| {' | '.join(columns)} | decode, CPU s |\n{'|---' * 7}|")
    with tempfile.TemporaryDirectory() as folder:
        reference = Reference(options.tmc3, Path(folder))
        for turns, step in ((1, 0.2), (options.turns, 0.1)):
            turn = virtual_turn("vlp16", turns=turns, step_deg=step)
            for mode in MODES:
                print(row(reference, turn, mode, options.repeats), flush=True)


if __name__ == "__main__":
    main()

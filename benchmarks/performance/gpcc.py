"""Time and size of our G-PCC geometry coder and of the reference software, side by side.

    python -m benchmarks.performance.gpcc TMC3 [--repeats 3] [--step 0.1] [--modes MODE ...]

Modes: the octree with the profiles minimal, ctc and defaults at scales 0.125, 0.5 and 1 (a
generated office, with the VLP-16's errors, scaled to 1023: 1,152,000 points with the azimuth step
0.1 deg), the octree with angular mode, and predictive geometry (turns of a level VLP-16 in that
office, mm, every point coded). TMC3's seconds are those that it prints, without its reading and
writing of files; ours are of arrays in memory, compiled before. The two take turns, and the least
time of the repeats counts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.checks import gpcc_angular_crosscheck as angular
from benchmarks.checks import gpcc_predictive_crosscheck as predictive
from benchmarks.clouds import scanned_room
from benchmarks.tmc3 import Reference
from benchmarks.turns import virtual_turn

from puckbench.codecs.tmc13 import PROFILES as TMC3_PROFILES
from puckbench.geometry.cloud import Floats
from puckbench.gpcc.coder import decode_geometry, encode_geometry
from puckbench.gpcc.grid import DEFAULT_GRID, quantise
from puckbench.gpcc.options import PROFILES, GpccOptions
from puckbench.gpcc.predictive_coder import PredictiveOptions, encode_predictive_geometry

SCALES = (0.125, 0.5, 1.0)
MODES = ("octree", "angular", "predictive")
LEAST_S = 0.001
"""TMC3 may print 0 seconds."""
MOST = 1 << 24
ONE_SLICE = {"enforceLevelLimits": 0, "sliceMaxPoints": MOST, "positionSliceQpFreqLog2": 8}


class Case(NamedTuple):
    name: str
    points: Floats
    options: dict[str, Any]
    scale: float
    encode: Callable[[], bytes]


def octree_cases(step_deg: float) -> Iterator[Case]:
    points = scanned_room("vlp16_divergence", step_deg)
    for profile, tools in PROFILES.items():
        if profile == "spinning":
            continue
        words = dict(word.removeprefix("--").split("=") for word in TMC3_PROFILES[profile])
        options = {**words, "mergeDuplicatedPoints": 1}
        for scale in SCALES:
            encode = partial(encoded_octree, points, tools, scale)
            yield Case(f"{profile}, scale {scale:g}", points, options, scale, encode)


def encoded_octree(points: Floats, tools: GpccOptions, scale: float) -> bytes:
    positions, origin = quantise(points, DEFAULT_GRID, scale, "truncate")
    return encode_geometry(positions, tools, scale, origin)


def angular_cases(step_deg: float) -> Iterator[Case]:
    turn, tools = virtual_turn("vlp16", step_deg=step_deg), GpccOptions(**angular.COMMON)
    encode = partial(encode_geometry, turn.points, tools, sensor=turn.sensor)
    options = angular.tmc3_options(tools, turn.sensor)
    yield Case("angular octree", turn.points.astype(np.float64), options, 1.0, encode)


def predictive_cases(step_deg: float) -> Iterator[Case]:
    turn = virtual_turn("vlp16", turns=20, step_deg=step_deg)
    lossy = {"radius_inv_scale_log2": 4, "azimuth_scale_log2": 9, "base_qp": 58}
    modes: dict[str, dict[str, Any]] = {
        "sensor": {},
        "sensor, radius 4": lossy,
        "Morton": {"order": "morton"},
    }
    for name, changes in modes.items():
        tools = PredictiveOptions(**changes, tree_max_points=MOST, slice_max_points=MOST)
        sensor = turn.sensor if "sensor" in name else None
        encode = partial(encode_predictive_geometry, turn.points, tools, sensor=sensor)
        options = {**predictive.tmc3_options(tools, sensor), **ONE_SLICE}
        yield Case(f"predictive, {name}", turn.points.astype(np.float64), options, 1.0, encode)


CASES = {"octree": octree_cases, "angular": angular_cases, "predictive": predictive_cases}


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def row(reference: Reference, case: Case, repeats: int) -> str:
    ours = case.encode()
    decode_geometry(ours).positions()
    least = np.full((2, 2), np.inf)  # encode and decode; TMC3 and ours
    for _ in range(repeats):
        theirs = reference.encode(case.points, case.options, case.scale)
        encode_s = reference.printed_seconds("wall")
        reference.decode(theirs)
        times = [
            [encode_s, seconds(case.encode)],
            [reference.printed_seconds("wall"), seconds(lambda: decode_geometry(ours).positions())],
        ]
        least = np.minimum(least, times)
    cells = [f"{a:.3f} / {b:.3f} ({b / max(a, LEAST_S):.2f})" for a, b in least.tolist()]
    sizes = f"{len(theirs):,} / {len(ours):,}"
    return f"| {case.name} | {len(case.points):,} | {sizes} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--step", type=float, default=0.1, help="azimuth step, degrees")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=MODES)
    options = parser.parse_args()
    print("TMC13 / ours (ratio)\n")
    print("| mode | points | bytes | encode, wall s | decode, wall s |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        reference = Reference(options.tmc3, Path(folder))
        for mode in options.modes:
            for case in CASES[mode](options.step):
                print(row(reference, case, options.repeats), flush=True)


if __name__ == "__main__":
    main()

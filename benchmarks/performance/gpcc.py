"""Time and size of our G-PCC geometry coder and of the reference software, side by side.

    python -m benchmarks.performance.gpcc TMC3 [--repeats 3] [--step 0.1] [--modes MODE ...]

Modes: the octree with the profiles minimal, ctc and defaults at scales 0.125, 0.5 and 1 (a
generated office, with the VLP-16's errors, scaled to 1023: 1,152,000 points with the azimuth step
0.1 deg), the octree with angular mode, and predictive geometry (turns of a level VLP-16 in that
office, mm, every point coded), and attributes (20 such turns as one cloud, by the octree, with
reflectances by the predicting and the lifting transform and RAHT; 18 turns are one slice). TMC3's
seconds, of its processor and of the clock, are those that it prints, without its reading and
writing of files; ours are of arrays in memory, compiled before. The two take turns, and the least
time of the repeats counts.

Aims, as shares of TMC3's wall time: at most 0.5 for Morton-ordered prediction trees and the
angular octree; for attributes of one slice at most 0.4 with ``OMP_NUM_THREADS=1``, or less with two
threads than with one.
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
from benchmarks.performance.rows import Inputs, Row
from benchmarks.tmc3 import Reference
from benchmarks.turns import virtual_turn
from tests.gpcc.attribute_vectors import reflectances

from gpcc.attributes.cloud import decode_cloud, encode_cloud
from gpcc.attributes.options import ATTRIBUTE_PROFILES
from gpcc.coder import decode_geometry, encode_geometry
from gpcc.grid import DEFAULT_GRID, quantise
from gpcc.options import PROFILES, GpccOptions
from gpcc.predictive_coder import PredictiveOptions, encode_predictive_geometry
from pointkit.geometry.cloud import Floats
from pointkit.geometry.morton import Ints
from puckbench.codecs.tmc13 import PROFILES as TMC3_PROFILES

SCALES = (0.125, 0.5, 1.0)
MODES = ("octree", "angular", "predictive", "attributes")
LEAST_S = 0.001
"""TMC3 may print 0 seconds."""
COMPARABLE_S = 0.02
"""Of shorter times, which TMC3 prints in whole ms, no aim is judged."""
MOST = 1 << 24
BY_SLICE = {"disableAttributeCoding": 0, "convertPlyColourspace": 1}
LEVELS = {"levelOfDetailCount": 12, "numberOfNearestNeighborsInPrediction": 3}
LIFTING = {**LEVELS, "lodDecimator": 1, "adaptivePredictionThreshold": 64, "qp": 34}
NEAREST = {
    "levelOfDetailCount": 0,
    "intraLodPredictionSkipLayers": 0,
    "qp": 4,
    "adaptivePredictionThreshold": 64,
    "direct_avg_predictor_disabled_flag": 1,
}
TRANSFORMS: dict[str, tuple[str, dict[str, Any]]] = {
    "predicting": ("lossless_lidar", {"transformType": 1, **NEAREST}),
    "lifting": ("lifting_lidar", {"transformType": 2, **LIFTING}),
    "RAHT": ("raht", {"transformType": 0, "qp": 34}),
}
ONE_SLICE = {"enforceLevelLimits": 0, "sliceMaxPoints": MOST, "positionSliceQpFreqLog2": 8}


class Case(NamedTuple):
    name: str
    points: Floats
    options: dict[str, Any]
    scale: float
    encode: Callable[[], bytes]
    decode: Callable[[bytes], object] = lambda stream: decode_geometry(stream).positions()
    reflectances: Ints | None = None


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
    tools = GpccOptions(**angular.COMMON, slice_max_points=MOST)
    for turns in (1, 20):
        turn = virtual_turn("vlp16", turns=turns, step_deg=step_deg)
        encode = partial(encode_geometry, turn.points, tools, sensor=turn.sensor)
        options = {**angular.tmc3_options(tools, turn.sensor), **ONE_SLICE}
        name = f"angular octree, turns: {turns}"
        yield Case(name, turn.points.astype(np.float64), options, 1.0, encode)


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


def attribute_cases(step_deg: float) -> Iterator[Case]:
    tools = PROFILES["ctc"].replaced(merge_duplicates=False)
    words = dict(word.removeprefix("--").split("=") for word in TMC3_PROFILES["ctc"])
    for turns in (18, 20):
        points = virtual_turn("vlp16", turns=turns, step_deg=step_deg).points
        values = reflectances(points)
        for name, (profile, given) in TRANSFORMS.items():
            chosen = {"reflectance": ATTRIBUTE_PROFILES[profile]}
            encode = partial(encode_cloud, points, {"reflectance": values}, tools, chosen)
            options = {**words, "mergeDuplicatedPoints": 0, **BY_SLICE, **given}
            options |= {"bitdepth": 8, "attrScale": 1, "attribute": "reflectance"}
            case = f"{name}, turns: {turns}", points.astype(float), options, 1.0
            yield Case(*case, encode, decode_cloud, values)


MAKERS = (octree_cases, angular_cases, predictive_cases, attribute_cases)
CASES = dict(zip(MODES, MAKERS, strict=True))
CLOCKS = ("user", "wall")
TIMES = [(name, unit) for name in ("encode", "decode") for unit in ("processor s", "s")]
RIVAL = "TMC13"
SLOWEST = ("angular octree", "predictive, Morton")
"""Cases that were slowest beside TMC13; the aim for their wall clock is `HALF` of its."""
HALF = 0.5


def seconds(call: Callable[[], object]) -> list[float]:
    cpu, wall = time.process_time(), time.perf_counter()
    call()
    return [time.process_time() - cpu, time.perf_counter() - wall]


def measure(inputs: Inputs) -> Iterator[Row]:
    return measured(inputs, "angular") if inputs.is_trial else measured(inputs, *MODES[:-1])


def measure_attributes(inputs: Inputs) -> Iterator[Row]:
    return measured(inputs, "angular" if inputs.is_trial else "attributes")


def measured(inputs: Inputs, *modes: str) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        reference = Reference(inputs.program("TMC3"), Path(folder))
        for mode in modes:
            for case in CASES[mode](8.0 if inputs.is_trial else 0.1):
                yield from rows(reference, case, inputs.repeats(3))


def rows(reference: Reference, case: Case, repeats: int) -> Iterator[Row]:
    """Bytes, which may be 0.5 % more than TMC3's, and times."""
    ours = case.encode()
    case.decode(ours)
    least = np.full((4, 2), np.inf)  # encode and decode, processor and wall time; TMC3 and ours
    for _ in range(repeats):
        theirs = reference.encode(case.points, case.options, case.scale, case.reflectances)
        times = [reference.printed_seconds(clock) for clock in CLOCKS]
        reference.decode(theirs)
        times += [reference.printed_seconds(clock) for clock in CLOCKS]
        own = seconds(case.encode) + seconds(lambda: case.decode(ours))
        least = np.minimum(least, np.column_stack([times, own]))
    what = f"{case.name}, {len(case.points):,} points"
    yield Row(f"{what}: size", len(ours), "bytes", RIVAL, len(theirs), at_most=1.005)
    for (name, unit), (rival, own) in zip(TIMES, least.tolist(), strict=True):
        pair = (own, unit, RIVAL, max(rival, LEAST_S))
        whole = HALF if unit == "s" and case.name.startswith(SLOWEST) else 1
        aim = whole if rival >= COMPARABLE_S else None
        yield Row(f"{what}: {name}", *pair, at_most=aim, repeats=repeats)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--step", type=float, default=0.1, help="azimuth step, degrees")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=MODES)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        reference = Reference(options.tmc3, Path(folder))
        for mode in options.modes:
            for case in CASES[mode](options.step):
                for row in rows(reference, case, options.repeats):
                    print(row, flush=True)


if __name__ == "__main__":
    main()

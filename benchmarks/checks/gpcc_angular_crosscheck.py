"""The octree's angular mode against the reference software, both ways, over sensors and options.

    python -m benchmarks.checks.gpcc_angular_crosscheck TMC3 [--recordings PATH ...]
        [--turns NAME ...] [--modes NAME ...]

For each turn of a virtual sensor, of the recordings, and for clouds that no sensor measures, under
each set of options: what TMC3 decodes from our stream must be the points that were coded, what we
decode from TMC3's stream must be what TMC3 decodes from it, and our stream may be at most 0.5 %
larger. Options that only a decoder knows (slices, axis orders, several entropy streams) are checked
on TMC3's streams alone. What TMC3 itself cannot code is counted apart. Exit status 1 if any case
fails.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from benchmarks.tmc3 import (
    DECODER_MODES,
    Checked,
    Reference,
    crosscheck,
    decode_with_both,
    differ,
    judged,
    sensor_options,
)
from benchmarks.turns import Turn, all_turns

from gpcc.coder import decode_geometry, encode_geometry
from gpcc.grid import InputGrid, quantise
from gpcc.options import PROFILES, SPINNING, GpccOptions
from gpcc.sensor import SensorDescription

COMMON: dict[str, Any] = {**PROFILES["ctc"].model_dump(exclude_defaults=True), **SPINNING}
"""MPEG's common test conditions for a spinning sensor's sparse clouds."""

MODES: dict[str, dict[str, Any]] = {
    "common": {},
    "merged": {"merge_duplicates": True},
    "planar buffer": {"planar_buffer": True},
    "no direct coding": {"inferred_direct_coding_mode": 0},
    "direct coding 1": {"inferred_direct_coding_mode": 1},
    "direct coding 1, some": {"inferred_direct_coding_mode": 1, "planar_mode_idcm_use": 13},
    "direct coding 2": {"inferred_direct_coding_mode": 2, "planar_buffer": True},
    "points one by one": {"joint_two_point_idcm": False},
    "no planes": {"planar": False},
    "thresholds": {"planar_thresholds": (5, 10, 20), "planar_buffer": True},
    "no qtbt": {"qtbt": False},
    "qtbt late": {"max_num_qtbt_before_ot": 0, "min_qtbt_size_log2": 3},
    "siblings": {"neighbour_avail_boundary_log2": 0, "planar_buffer": True},
    "no adjacent children": {"adjacent_child_contextualization": False},
    "half": {"scale": 0.5},
    "eighth": {"scale": 0.125, "merge_duplicates": True},
}
"""Changes of our options by the name of a mode; scale: of the input."""

OCTREE_DECODER_MODES = {
    **DECODER_MODES,
    "streams": {"numOctreeEntropyStreams": 5},
    "zxy": {"geometry_axis_order": 3},
}


def tmc3_options(options: GpccOptions, sensor: SensorDescription) -> dict[str, Any]:
    first, second, third = options.planar_thresholds
    return {
        "mergeDuplicatedPoints": int(options.merge_duplicates),
        "neighbourAvailBoundaryLog2": options.neighbour_avail_boundary_log2,
        "adjacentChildContextualization": int(options.adjacent_child_contextualization),
        "intra_pred_max_node_size_log2": options.intra_pred_max_node_size_log2,
        "planarEnabled": int(options.planar),
        "planarModeThreshold0": first,
        "planarModeThreshold1": second,
        "planarModeThreshold2": third,
        "planarBufferDisabled": int(not options.planar_buffer),
        "qtbtEnabled": int(options.qtbt),
        "maxNumQtBtBeforeOt": options.max_num_qtbt_before_ot,
        "minQtbtSizeLog2": options.min_qtbt_size_log2,
        "inferredDirectCodingMode": options.inferred_direct_coding_mode,
        "planarModeIdcmUse": options.planar_mode_idcm_use,
        "jointTwoPointIdcm": int(options.joint_two_point_idcm),
        **sensor_options(sensor),
    }


def checked(reference: Reference, turn: Turn, changes: dict[str, Any]) -> Checked:
    known = {**COMMON, **changes}
    scale = known.pop("scale", 1)
    split: dict[str, Any] = {
        "angular_max_node_min_dim_log2_to_split_z": 8 + int(np.log2(scale)),
        "angular_max_diff_to_split_z": max(0, 1 + int(np.log2(scale))),
    }
    options = GpccOptions(**known, **split)
    points, sensor = turn.points.astype(np.float64), turn.sensor
    theirs = reference.encode(points, tmc3_options(options, sensor), scale)
    x, y, z = (int(place * scale) for place in sensor.position)
    heights = tuple(height * scale for height in sensor.height)
    here = SensorDescription(sensor.tan_elevation, heights, sensor.steps_per_turn, (x, y, z))
    positions, origin = quantise(points, InputGrid(), scale, "truncate")
    mine = encode_geometry(positions, options, scale, origin.tolist(), here)
    wanted = reference.decode(theirs)
    faults = {
        "TMC3 decodes ours otherwise": differ(reference.decode(mine), wanted),
        "we decode TMC3's otherwise": differ(decode_geometry(theirs).positions(), wanted),
        "we decode ours otherwise": differ(decode_geometry(mine).positions(), wanted),
    }
    return judged(mine, theirs, faults)


def main() -> None:
    coded = {name: partial(checked, changes=changes) for name, changes in MODES.items()}
    options = partial(tmc3_options, GpccOptions(**COMMON))
    decoder_alone = {
        name: partial(decode_with_both, options=options, changes=changes)
        for name, changes in OCTREE_DECODER_MODES.items()
    }
    crosscheck(
        __doc__,
        partial(all_turns, step_deg=None, clean_step_deg=None, most=2),
        {**coded, **decoder_alone},
    )


if __name__ == "__main__":
    main()

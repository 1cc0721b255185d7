"""Predictive geometry against the reference software, both ways, over sensors and options.

    python -m benchmarks.checks.gpcc_predictive_crosscheck TMC3 [--recordings PATH ...]
        [--turns NAME ...] [--modes NAME ...]

For each turn of a virtual sensor, of the recordings, and for clouds that no sensor measures, under
each set of options: what TMC3 decodes from our stream must be what we decode from it, and without
loss the points that were coded; what we decode from TMC3's stream must be what TMC3 decodes from
it; and our stream may be at most 0.5 % larger. Options that only a decoder knows (slices, axis
orders, bypass) are checked on TMC3's streams alone. What TMC3 itself cannot code is counted apart.
Exit status 1 if any case fails.
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

from gpcc.coder import decode_geometry
from gpcc.predictive_coder import PredictiveOptions, encode_predictive_geometry
from gpcc.sensor import SensorDescription
from pointkit.errors import InputError

AS_TMC3: dict[str, Any] = {"slice_qp_interval_log2": 0}
"""TMC3's default for slices differs from its default for streams."""
LOSSY = (1, 12), (2, 11), (4, 9), (5, 8), (7, 7), (8, 7)
"""Steps of radius and azimuth (powers of two) of MPEG's conditions."""

MODES: dict[str, dict[str, Any]] = {
    "sensor": {},
    "sensor, merged": {"merge_duplicates": True},
    "sensor, as given": {"order": "given"},
    "sensor, Morton": {"order": "morton"},
    "sensor, radius": {"order": "radius"},
    "sensor, exact azimuth": {"azimuth_sort_precision": 0.0},
    "sensor, angles": {"azimuth_scaling": False},
    "sensor, short trees": {"tree_max_points": 700},
    "sensor, QP 3": {"base_qp": 3},
    **{
        f"sensor, radius {radius}": {
            "radius_inv_scale_log2": radius,
            "azimuth_scale_log2": azimuth,
            "base_qp": 58,
        }
        for radius, azimuth in LOSSY
    },
    "azimuth": {"angular": False},
    "azimuth, coarse": {"angular": False, "azimuth_sort_precision": 8.0},
    "Morton": {"angular": False, "order": "morton"},
    "as given": {"angular": False, "order": "given"},
    "radius": {"angular": False, "order": "radius"},
    "Morton, merged": {"angular": False, "order": "morton", "merge_duplicates": True},
    "short trees": {"angular": False, "tree_max_points": 700},
    "QP 21": {"angular": False, "base_qp": 21},
    "QP 12, doubled": {"angular": False, "base_qp": 12, "qp_multiplier_log2": 1},
}
"""Changes of our options by the name of a mode; angular: with the sensor."""

TREE_DECODER_MODES = {
    **DECODER_MODES,
    "slice QP": {"positionQuantisationEnabled": 1, "positionSliceQpOffset": 9},
}

ORDERS = {"given": 0, "morton": 1, "azimuth": 2, "radius": 3}


def tmc3_options(options: PredictiveOptions, sensor: SensorDescription | None) -> dict[str, Any]:
    named: dict[str, Any] = {
        "geomTreeType": 1,
        "mergeDuplicatedPoints": int(options.merge_duplicates),
        "predGeomSort": ORDERS[options.order],
        "predGeomAzimuthSortPrecision": options.azimuth_sort_precision,
        "predGeomTreePtsMax": options.tree_max_points,
        "partitionMethod": 0,
    }
    if options.base_qp is not None:
        named |= {
            "positionQuantisationEnabled": 1,
            "positionBaseQp": options.base_qp,
            "positionQpMultiplierLog2": options.qp_multiplier_log2,
        }
    if sensor is not None:
        turn = 1 << (12 + options.azimuth_scale_log2)
        named |= {
            "positionAzimuthScaleLog2": options.azimuth_scale_log2,
            "positionAzimuthSpeed": round(turn / sensor.steps_per_turn),
            "positionRadiusInvScaleLog2": options.radius_inv_scale_log2,
            "predGeomAzimuthQuantization": int(options.azimuth_scaling),
            **sensor_options(sensor),
        }
    return named


def checked(reference: Reference, turn: Turn, changes: dict[str, Any]) -> Checked:
    known = {**AS_TMC3, **changes}
    sensor = turn.sensor if known.pop("angular", True) else None
    options = PredictiveOptions(**known)
    points = turn.points.astype(np.float64)
    if sensor is None:  # the reference orders by azimuth around the origin of the coordinates
        points -= turn.sensor.position
    theirs = reference.encode(points, tmc3_options(options, sensor))
    mine = encode_predictive_geometry(points.astype(np.int64), options, sensor=sensor)
    ours = decode_geometry(mine).positions()
    faults = {
        "TMC3 decodes ours otherwise": differ(reference.decode(mine), ours),
        "we decode TMC3's otherwise": differ(
            decode_geometry(theirs).positions(), reference.decode(theirs)
        ),
    }
    if options.base_qp is None:
        kept = np.unique(points, axis=0) if options.merge_duplicates else points
        faults["points are lost"] = differ(ours, kept)
    return judged(mine, theirs, faults)


def main() -> None:
    coded = {name: partial(checked, changes=changes) for name, changes in MODES.items()}
    options = partial(tmc3_options, PredictiveOptions())
    decoder_alone = {
        name: partial(decode_with_both, options=options, changes=changes)
        for name, changes in TREE_DECODER_MODES.items()
    }
    crosscheck(
        __doc__,
        partial(all_turns, step_deg=0.5, clean_step_deg=0.8, most=1),
        {**coded, **decoder_alone},
        refusals=(InputError,),
    )


if __name__ == "__main__":
    main()

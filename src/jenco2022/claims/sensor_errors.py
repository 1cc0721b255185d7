from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import TYPE_CHECKING

from jenco2022.claims.evidence import Evidence
from jenco2022.claims.verdicts import Part, untested
from jenco2022.published import BIN_STDS_M, FAR_M, PRINTED_STD_M, REAL_STD_M
from jenco2022.tables.residual_statistics import ALL
from jenco2022.tables.thesis_numbers import DISTANCE
from pointkit.geometry.cloud import Floats
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd

MEAN_ROUNDING_M = 0.005
"""Largest rounding error of the mean, in m; the thesis prints it to a centimetre."""
STD_ROUNDING_M = 0.0005
"""Largest rounding error of the standard deviation, in m; the thesis prints it to a millimetre."""
FAR_TOO_WIDE = 2.0
"""Ratio of simulated to real standard deviation above which noise is far too wide.

The thesis states the real sensor's error as two standard deviations.
"""
ALMOST_NO_DIFFERENCE = 0.0198 / 0.0186 - 1
"""Relative difference of the thesis's standard deviations with and without beam divergence."""
FLAT = BIN_STDS_M[8] / median(BIN_STDS_M)
"""Largest ratio of a group's standard deviation to the median of all groups that counts as flat.

In Figure 5.15, the thesis calls ratios up to 1.13 flat, and this ratio (1.31) an increase.
"""
MIN_RESIDUALS = 100
CAPTURES = "captures of a real VLP-16 (sensor_study: captures)"
STUDY = "the sensor study (sensor_study)"


def real_spread(evidence: Evidence) -> list[Part]:
    """Test whether plane residuals of a real sensor have the thesis's mean and standard deviation.

    This is claim 1 of the thesis. It holds if the values of captures round to those of the thesis.
    """
    if not len(_row(evidence, REAL)):
        return [untested(CAPTURES)]
    parts = []
    for surface in ("wall", "floor"):
        rows = _row(evidence, REAL, surface=surface)
        if not len(rows):
            parts.append(untested(f"a capture with a {surface}"))
            continue
        mean, std = (float(rows[name].iloc[0]) for name in ("mean_m", "std_m"))
        sample, is_zero = _sample(rows), abs(mean) < MEAN_ROUNDING_M
        parts.append(Part(f"{surface}: mean 0.00", is_zero, f"{mean:.4f} m", sample=sample))
        is_equal = abs(std - PRINTED_STD_M) <= STD_ROUNDING_M
        parts.append(Part(f"{surface}: std 0.014", is_equal, f"{std:.4f} m", sample=sample))
    return parts


def default_noise_too_wide(evidence: Evidence) -> list[Part]:
    """Test whether the noise of the error model ``hdl64e`` is far too wide for a VLP-16.

    This is claim 2 of the thesis. It holds if the residuals of ``hdl64e`` have more than
    `FAR_TOO_WIDE` times the real standard deviation, and are farther from the real distribution
    than the residuals of ``vlp16``.
    """
    wide, real = _std(evidence, "hdl64e"), _std(evidence, REAL) or REAL_STD_M
    if wide is None:
        return [untested(f"{STUDY} with the error model hdl64e")]
    measured = f"{wide:.4f} m against {real:.4f} m, {wide / real:.2g} times"
    sample, is_wider = _sample(_row(evidence, "hdl64e")), wide > FAR_TOO_WIDE * real
    of_simulator = not len(_row(evidence, REAL))
    statement = "residuals spread more than twice as far"
    parts = [Part(statement, is_wider, measured, sample=sample, of_simulator=of_simulator)]
    far, near = (_distance(evidence, model) for model in ("hdl64e", "vlp16"))
    if far is None or near is None:
        return [*parts, untested(f"{STUDY} with the error models hdl64e and vlp16")]
    measured = f"earth mover's distance {far:.4f} m against {near:.4f} m of vlp16"
    sample = _sample(_row(evidence, "hdl64e"), _row(evidence, "vlp16"))
    statement = "farther from the real distribution"
    part = Part(statement, far > near, measured, sample=sample, of_simulator=of_simulator)
    return [*parts, part]


def divergence_is_negligible(evidence: Evidence) -> list[Part]:
    """Test whether beam divergence hardly changes the plane residuals.

    This is claim 3 of the thesis. It holds if the standard deviations with and without divergence
    differ by at most the fraction `ALMOST_NO_DIFFERENCE`, or by less than their 95 % intervals.
    """
    parts = []
    for distance in ("5", f"{FAR_M:g}"):
        pair = [
            _row(evidence, model, distance_m=distance) for model in ("vlp16", "vlp16_divergence")
        ]
        if not all(map(len, pair)):
            parts.append(untested(f"{STUDY} with vlp16 and vlp16_divergence from {distance} m"))
            continue
        (without, half_without), (with_it, half_with) = (
            rows[["std_m", "std_half_m"]].fillna(0.0).iloc[0] for rows in pair
        )
        allowed = max(ALMOST_NO_DIFFERENCE * without, math.hypot(half_without, half_with))
        measured = f"std {without:.4f} m without, {with_it:.4f} m with it"
        is_equal = bool(abs(with_it - without) <= allowed)
        sample = _sample(*pair)
        statement = f"no difference at {distance} m"
        parts.append(Part(statement, is_equal, measured, sample=sample, of_simulator=True))
    return parts


def incidence_not_modelled(evidence: Evidence) -> list[Part]:
    """Test whether range noise that grows with the angle of incidence fails to widen the residuals.

    This is claim 4 of the thesis. It holds if the range error of ``vlp16_incidence`` rises with the
    angle, but the distance to the true surface rises by less than the square root of the factor in
    Figure 5.15.
    """
    table = evidence.incidence_effect
    rows = None if table is None else table[table["model"] == "vlp16_incidence"]
    if rows is None or len(rows) < 2:
        return [untested(f"{STUDY} with the error model vlp16_incidence, from 1 or 5 m")]
    bins = rows.sort_values("low_rad")
    range_error = bins["range_error_std_m"].to_numpy(dtype=float)
    distance = bins["surface_distance_std_m"].to_numpy(dtype=float)
    half_rise = math.sqrt(BIN_STDS_M[-1] / BIN_STDS_M[0])
    sample, rises = _sample(bins.iloc[[0, -1]]), bool(range_error[-1] > range_error[0])
    return [
        Part("range error rises", rises, _from_to(range_error), sample=sample, of_simulator=True),
        Part(
            "distance to the surface does not",
            bool(distance[-1] / distance[0] < half_rise),
            f"{_from_to(distance)}; real {_from_to(BIN_STDS_M)}",
            sample=sample,
            of_simulator=True,
        ),
    ]


def no_dependence_on_distance_or_laser(evidence: Evidence) -> list[Part]:
    """Test whether the noise depends neither on the distance nor on the laser.

    This is claim 5 of the thesis. It holds if the standard deviations at all distances, and of all
    lasers, are within a factor `FLAT` of their median. In captures, only lasers are compared,
    because each distance has another plane.
    """
    model = "vlp16_divergence"
    parts = [
        *_flatness(evidence, REAL, "laser_id"),
        *_flatness(evidence, model, "distance_m"),
        *_flatness(evidence, model, "laser_id"),
    ]
    if not parts:
        return [untested(STUDY)]
    missing = "captures of one wall from several distances"
    return [*parts, untested(missing if len(_row(evidence, REAL)) else CAPTURES)]


def _flatness(evidence: Evidence, model: str, key: str) -> list[Part]:
    parts = []
    title = {"distance_m": "distance", "laser_id": "laser"}[key]
    for surface in ("wall", "floor"):
        rows = _groups(evidence, model, surface, key)
        if len(rows) < 2:
            continue
        stds = rows["std_m"]
        low, middle, high = (float(value) for value in stds.quantile([0, 0.5, 1]))
        is_flat = max(high / middle, middle / low) <= FLAT
        measured = f"std {low:.4f} to {high:.4f} m, median {middle:.4f} m"
        sample = f"{_sample(rows)}, {len(rows)} {title}s"
        statement = f"{model}, {surface}: not on the {title}"
        parts.append(Part(statement, is_flat, measured, sample=sample))
    return parts


def _groups(evidence: Evidence, model: str, surface: str, key: str) -> pd.DataFrame:
    other = "laser_id" if key == "distance_m" else "distance_m"
    rows = _rows(evidence, model, **{"surface": surface, other: ALL})
    if rows.empty:
        return rows
    rows = rows[(rows[key] != ALL) & (rows["count"] >= MIN_RESIDUALS)]
    if key == "distance_m":
        rows = rows[rows[key].astype(float) < FAR_M]
    return rows


def _rows(evidence: Evidence, model: str, **keys: str) -> pd.DataFrame:
    import pandas as pd

    table = evidence.residual_statistics
    if table is None:
        return pd.DataFrame()
    rows = table.astype({"distance_m": str, "laser_id": str})
    for name, value in {"model": model, **keys}.items():
        rows = rows[rows[name] == value]
    return rows


def _row(evidence: Evidence, model: str, **keys: str) -> pd.DataFrame:
    return _rows(evidence, model, **{"surface": ALL, "distance_m": ALL, "laser_id": ALL, **keys})


def _sample(*rows: pd.DataFrame) -> str:
    counts = [each["count"].sum() for each in rows if "count" in each]
    return f"{int(sum(counts)):,} residuals" if counts else ""


def _std(evidence: Evidence, model: str) -> float | None:
    rows = _row(evidence, model)
    return float(rows["std_m"].iloc[0]) if len(rows) else None


def _distance(evidence: Evidence, model: str) -> float | None:
    table = evidence.thesis_numbers
    if table is None:
        return None
    rows = table[(table["quantity"] == DISTANCE) & (table["model"] == model)]
    return float(rows["here_m"].iloc[0]) if len(rows) else None


def _from_to(values: Sequence[float] | Floats) -> str:
    return f"{values[0]:.4f} to {values[-1]:.4f} m"

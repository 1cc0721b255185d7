"""The thesis's claims about the sensor's errors (sections 5.1.3 and 5.5)."""

from __future__ import annotations

import math
from statistics import median
from typing import TYPE_CHECKING

from puckbench.lidar.residual_table import REAL
from puckbench.thesis.claims.evidence import Evidence
from puckbench.thesis.claims.parts import Part, needs
from puckbench.thesis.published import BIN_STDS_M, FAR_M, PRINTED_STD_M, REAL_STD_M
from puckbench.thesis.tables.numbers import MOVED
from puckbench.thesis.tables.residual_statistics import ALL

if TYPE_CHECKING:
    import pandas as pd

CENTIMETRE = 0.005
"""The thesis prints the mean to a centimetre: nearer to zero than half of one is 0.00 m."""
MILLIMETRE = 0.0005
"""It prints the standard deviation to a millimetre."""
FAR_TOO_WIDE = 2.0
"""Twice the spread: the real sensor's error as the thesis cites it (two standard deviations)
would hold no more than one of the model's."""
NEXT_TO_NOTHING = 0.0198 / 0.0186 - 1
"""The thesis's printed spreads with and without divergence differ so much, which it calls
"almost no discernible difference"."""
FLAT = BIN_STDS_M[8] / median(BIN_STDS_M)
"""A spread over the groups' median, up to which there is no dependence. In Figure 5.15 the thesis
passes eight bins within 1.13 of the median as flat and sees an increase in the next, at 1.31."""
LEAST_RESIDUALS = 100
CAPTURES = "captures of a real VLP-16 (sensor_study: captures)"
STUDY = "the sensor study (sensor_study)"


def real_spread(evidence: Evidence) -> list[Part]:
    """Claim 1: real residuals have mean 0.00 and std 0.014 m, walls and floors alike.

    For each surface that captures have: the mean is within `CENTIMETRE` of zero, the standard
    deviation is 0.014 m to `MILLIMETRE`. Other devices than the thesis's, and other walls, are
    other samples of the sensor: that they differ is a finding, no fault of the thesis.
    """
    if not len(_row(evidence, REAL)):
        return [needs(CAPTURES)]
    parts = []
    for surface in ("wall", "floor"):
        rows = _row(evidence, REAL, surface=surface)
        if not len(rows):
            parts.append(needs(f"a capture with a {surface}"))
            continue
        mean, std = (float(rows[name].iloc[0]) for name in ("mean_m", "std_m"))
        sample, near_zero = _sample(rows), abs(mean) < CENTIMETRE
        parts.append(Part(f"{surface}: mean 0.00", near_zero, f"{mean:.4f} m", sample=sample))
        near = abs(std - PRINTED_STD_M) <= MILLIMETRE
        parts.append(Part(f"{surface}: std 0.014", near, f"{std:.4f} m", sample=sample))
    return parts


def default_noise_too_wide(evidence: Evidence) -> list[Part]:
    """Claim 2: the HDL-64E's noise is far too wide for a VLP-16.

    The spread of its residuals is more than twice (`FAR_TOO_WIDE`) the real sensor's, of captures
    where there are some, else 0.0138 m; and its earth mover's distance to the real distribution is
    greater than that of the model `vlp16`.
    """
    wide, real = _std(evidence, "hdl64e"), _std(evidence, REAL) or REAL_STD_M
    if wide is None:
        return [needs(f"{STUDY} with the error model hdl64e")]
    found = f"{wide:.4f} m against {real:.4f} m, {wide / real:.2g} times"
    sample, wider = _sample(_row(evidence, "hdl64e")), wide > FAR_TOO_WIDE * real
    parts = [Part("residuals spread more than twice as far", wider, found, sample=sample)]
    far, near = (_moved(evidence, model) for model in ("hdl64e", "vlp16"))
    if far is None or near is None:
        return [*parts, needs(f"{STUDY} with the error models hdl64e and vlp16")]
    found = f"earth mover's distance {far:.4f} m against {near:.4f} m of vlp16"
    both = _sample(_row(evidence, "hdl64e"), _row(evidence, "vlp16"))
    return [*parts, Part("farther from the real distribution", far > near, found, sample=both)]


def divergence_is_negligible(evidence: Evidence) -> list[Part]:
    """Claim 3: beam divergence changes next to nothing, at 5 m and at 30 m.

    With and without it the residuals' standard deviations differ by no more than what the thesis
    printed and called negligible (`NEXT_TO_NOTHING`), or than the 95 % intervals of repeated scans
    together.
    """
    parts = []
    for distance in ("5", f"{FAR_M:g}"):
        pair = [
            _row(evidence, model, distance_m=distance) for model in ("vlp16", "vlp16_divergence")
        ]
        if not all(map(len, pair)):
            parts.append(needs(f"{STUDY} with vlp16 and vlp16_divergence from {distance} m"))
            continue
        (without, half), (with_it, other) = (
            rows[["std_m", "std_half_m"]].fillna(0.0).iloc[0] for rows in pair
        )
        allowed = max(NEXT_TO_NOTHING * without, math.hypot(half, other))
        found = f"std {without:.4f} m without, {with_it:.4f} m with it"
        alike = abs(with_it - without) <= allowed
        sample = _sample(*pair)
        parts.append(Part(f"no difference at {distance} m", bool(alike), found, sample=sample))
    return parts


def incidence_not_modelled(evidence: Evidence) -> list[Part]:
    """Claim 4: a sigma that rises with incidence does not raise the residuals as the real floor's.

    Of the model `vlp16_incidence`, from the first to the last bin of incidence: the range error
    rises, yet the distance to the true surface rises by less than half of what the real residuals
    do (0.0118 to 0.0246 m, Figure 5.15), in the logarithm.
    """
    table = evidence.incidence_effect
    rows = None if table is None else table[table["model"] == "vlp16_incidence"]
    if rows is None or len(rows) < 2:
        return [needs(f"{STUDY} with the error model vlp16_incidence, from 1 or 5 m")]
    ordered = rows.sort_values("low_rad")
    along = ordered["range_error_std_m"].to_numpy(dtype=float)
    off = ordered["surface_distance_std_m"].to_numpy(dtype=float)
    rise = math.sqrt(BIN_STDS_M[-1] / BIN_STDS_M[0])
    sample, rises = _sample(ordered.iloc[[0, -1]]), bool(along[-1] > along[0])
    return [
        Part("range error rises", rises, _from_to(along[0], along[-1]), sample=sample),
        Part(
            "distance to the surface does not",
            bool(off[-1] / off[0] < rise),
            f"{_from_to(off[0], off[-1])}; real {_from_to(BIN_STDS_M[0], BIN_STDS_M[-1])}",
            sample=sample,
        ),
    ]


def no_dependence_on_distance_or_laser(evidence: Evidence) -> list[Part]:
    """Claim 5: the noise depends neither on the distance from 1 to 5 m nor on the laser.

    For walls and floors, over the distances and over the lasers: no standard deviation is more
    than `FLAT` times their median, or less than it by as much. Of the model
    `vlp16_divergence`, which the thesis chose, and of captures where there are some; they tell of
    the lasers alone, since planes at other distances are other planes. Groups of fewer than a
    hundred residuals do not count.
    """
    chosen = "vlp16_divergence"
    parts = [
        *_flat(evidence, REAL, "laser_id"),
        *_flat(evidence, chosen, "distance_m"),
        *_flat(evidence, chosen, "laser_id"),
    ]
    if not parts:
        return [needs(STUDY)]
    missing = "captures of one wall from several distances"
    return [*parts, needs(missing if len(_row(evidence, REAL)) else CAPTURES)]


def _flat(evidence: Evidence, model: str, key: str) -> list[Part]:
    """A part for each surface whose standard deviations are known for two values of a key."""
    parts = []
    title = {"distance_m": "distance", "laser_id": "laser"}[key]
    for surface in ("wall", "floor"):
        rows = _groups(evidence, model, surface, key)
        if len(rows) < 2:
            continue
        stds = rows["std_m"]
        low, middle, high = (float(value) for value in stds.quantile([0, 0.5, 1]))
        flat = max(high / middle, middle / low) <= FLAT
        found = f"std {low:.4f} to {high:.4f} m, median {middle:.4f} m"
        sample = f"{_sample(rows)}, {len(rows)} {title}s"
        says = f"{model}, {surface}: not on the {title}"
        parts.append(Part(says, flat, found, sample=sample))
    return parts


def _groups(evidence: Evidence, model: str, surface: str, key: str) -> pd.DataFrame:
    """Statistics for each value of one key, over all of the other."""
    other = "laser_id" if key == "distance_m" else "distance_m"
    rows = _rows(evidence, model, **{"surface": surface, other: ALL})
    if rows.empty:
        return rows
    rows = rows[(rows[key] != ALL) & (rows["count"] >= LEAST_RESIDUALS)]
    if key == "distance_m":
        rows = rows[rows[key].astype(float) < FAR_M]
    return rows


def _rows(evidence: Evidence, model: str, **keys: str) -> pd.DataFrame:
    """Rows of the statistics of one model, with these keys."""
    import pandas as pd

    table = evidence.residual_statistics
    if table is None:
        return pd.DataFrame()
    rows = table.astype({"distance_m": str, "laser_id": str})
    wanted = {"model": model, **keys}
    for name, value in wanted.items():
        rows = rows[rows[name] == value]
    return rows


def _row(evidence: Evidence, model: str, **keys: str) -> pd.DataFrame:
    """The one row over everything but the keys given; none where there is none."""
    return _rows(evidence, model, **{"surface": ALL, "distance_m": ALL, "laser_id": ALL, **keys})


def _sample(*rows: pd.DataFrame) -> str:
    """How many residuals the rows of statistics are of; empty where that is not known."""
    known = [each["count"].sum() for each in rows if "count" in each]
    return f"{int(sum(known)):,} residuals" if known else ""


def _std(evidence: Evidence, model: str) -> float | None:
    rows = _row(evidence, model)
    return float(rows["std_m"].iloc[0]) if len(rows) else None


def _moved(evidence: Evidence, model: str) -> float | None:
    """Earth mover's distance of a model to the thesis's real residuals, m."""
    table = evidence.thesis_numbers
    if table is None:
        return None
    rows = table[(table["quantity"] == MOVED) & (table["model"] == model)]
    return float(rows["here_m"].iloc[0]) if len(rows) else None


def _from_to(first: float, last: float) -> str:
    return f"{first:.4f} to {last:.4f} m"

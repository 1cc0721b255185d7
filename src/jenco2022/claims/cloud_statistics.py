from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jenco2022.claims.evidence import MIN_CLOUDS, Evidence
from jenco2022.claims.rate_distortion import CODEC_NEEDS, TITLES, TWICE
from jenco2022.claims.verdicts import Part, untested
from jenco2022.published import ALL_ROOMS, CLASSICAL, DRACO, LEARNED, OBJECTS, ROOMS, SCANS
from pointkit.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

MIN_ROOMS = 16
VISIBLE = 0.5
"""Absolute rank correlation from which an effect counts as visible.

It explains a quarter of the variance and, with `MIN_ROOMS` rooms, is significant at 5 %. Weaker
correlations are not visible in a scatter plot.
"""
MORE_DUPLICATES = 0.05
"""Smallest difference that counts between two shares of duplicate points; smaller differences
cannot double the bits.
"""


def draco_shifted_by_duplicates(evidence: Evidence) -> list[Part]:
    """Test whether duplicate points shift Draco's curve to more bits on scans than on objects.

    This is claim 12 of the thesis. It holds if, at Draco's first rate, scans take more than `TWICE`
    times the bits per point that objects take, and have more duplicate points.
    """
    if DRACO not in evidence.codecs:
        return [untested(CODEC_NEEDS[DRACO])]
    objects, scans = evidence.with_role(OBJECTS), evidence.with_role(*SCANS)
    if not objects or not scans:
        return [untested("an object set and scans")]
    if not evidence.has_enough_clouds((*objects, *scans), DRACO):
        return [untested(f"{MIN_CLOUDS} clouds or more")]
    bpp = {name: evidence.rates(name, DRACO, "bpp") for name in (*objects, *scans)}
    on_objects = max(bpp[name][0] for name in objects)
    measured = ", ".join(f"{name} {_ends(values)} bpp" for name, values in bpp.items())
    is_shifted = all(bpp[name][0] > TWICE * on_objects for name in scans)
    sample = "" if evidence.of_medians else f"{evidence.clouds_of(bpp, DRACO)} clouds"
    parts = [Part("shifted to more bits on scans", is_shifted, measured, sample=sample)]
    shares = {name: _duplicates(evidence, name) for name in bpp}
    if any(np.isnan(share) for share in shares.values()):
        return [*parts, untested("counts of the decoded points")]
    on_objects = max(shares[name] for name in objects)
    has_more = all(shares[name] > on_objects + MORE_DUPLICATES for name in scans)
    measured = ", ".join(f"{name} {share:.2%}" for name, share in shares.items())
    statement = "more points fall together there at the first rate"
    return [*parts, Part(statement, has_more, measured, sample=sample)]


def elongation_has_no_effect(evidence: Evidence) -> list[Part]:
    """Test whether the elongation of rooms has no effect on the Chamfer distance.

    This is claim 13 of the thesis. It holds for a codec if the rank correlation of elongation and
    Chamfer distance over rooms is below `VISIBLE` in absolute value.
    """
    table = evidence.metrics
    rooms = [
        name for name in evidence.with_role(*ALL_ROOMS, *SCANS) if _has_enough_rooms(table, name)
    ]
    if table is None or not rooms or "elongation" not in table:
        return [untested(f"a set of {MIN_ROOMS} rooms or more")]
    parts = []
    for role in (*CLASSICAL, *LEARNED):
        if role not in evidence.codecs:
            parts.append(untested(CODEC_NEEDS[role]))
            continue
        rows = table[table["codec"] == evidence.codecs[role]]
        correlations = {name: _correlation(rows[rows["dataset"] == name]) for name in rooms}
        text = ", ".join(f"{name} {value:+.2f}" for name, value in correlations.items())
        is_weak = all(abs(value) < VISIBLE for value in correlations.values())
        measured = f"rank correlation with CD: {text}"
        sample = f"{evidence.clouds_of(rooms, role)} rooms, {rows['rate'].nunique()} rates"
        parts.append(Part(f"{TITLES[role]}: none", is_weak, measured, sample=sample))
    return parts


def scans_have_alike_counts(evidence: Evidence) -> list[Part]:
    """Test whether scans have more similar numbers of points than recorded rooms have.

    This is claim 14 of the thesis. It holds if the scans' numbers of points have a smaller
    interquartile range and a larger median.
    """
    table = evidence.clouds
    counts = {} if table is None else dict(iter(table.groupby("dataset")["points"]))
    rooms = _with_enough_clouds(evidence, counts, ROOMS)
    scans = _with_enough_clouds(evidence, counts, *SCANS)
    if not rooms or not scans:
        return [untested("captured rooms as clouds (make: cloud) and their scans")]
    spread = {name: float(np.subtract(*counts[name].quantile([0.75, 0.25]))) for name in counts}
    median = {name: float(counts[name].median()) for name in counts}
    parts = []
    for room in rooms:
        for scan in scans:
            spreads = f"interquartile ranges {spread[scan]:,.0f} and {spread[room]:,.0f} points"
            medians = f"medians {median[scan]:,.0f} and {median[room]:,.0f} points"
            is_narrower, is_higher = spread[scan] < spread[room], median[scan] > median[room]
            sample = f"{len(counts[scan])} and {len(counts[room])} clouds"
            parts.append(Part(f"{scan} narrower than {room}", is_narrower, spreads, sample=sample))
            parts.append(Part(f"{scan} higher than {room}", is_higher, medians, sample=sample))
    return parts


def _with_enough_clouds(
    evidence: Evidence, counts: dict[str, pd.Series[float]], *roles: str
) -> list[str]:
    return [
        name
        for name, role in evidence.datasets.items()
        if role in roles and len(counts.get(name, ())) >= MIN_CLOUDS
    ]


def _has_enough_rooms(table: pd.DataFrame | None, dataset: str) -> bool:
    if table is None:
        return False
    return int(table.loc[table["dataset"] == dataset, "cloud"].nunique()) >= MIN_ROOMS


def _correlation(rows: pd.DataFrame) -> float:
    """Return the median over rates of the rank correlation of elongation and CD, or 0."""
    correlations = [
        float(part[["elongation", "cd_plane"]].rank().corr().to_numpy(dtype=float)[0, 1])
        for _, part in rows.groupby("rate")
    ]
    defined = [value for value in correlations if not np.isnan(value)]
    return float(np.median(defined)) if defined else 0.0


def _duplicates(evidence: Evidence, dataset: str) -> float:
    table = evidence.metrics
    if table is None or not {"points_b", "points_out"} <= set(table):
        return float("nan")
    medians = evidence.medians
    draco = medians[(medians["dataset"] == dataset) & (medians["codec"] == DRACO)]
    first_rate = draco.sort_values("number")["rate"].iloc[0]
    keys = {"dataset": dataset, "codec": evidence.codecs[DRACO], "rate": first_rate}
    for name, value in keys.items():
        table = table[table[name] == value]
    return float((1 - table["points_b"] / table["points_out"]).median())


def _ends(values: Floats) -> str:
    return f"{values[0]:.3g} to {values[-1]:.3g}"

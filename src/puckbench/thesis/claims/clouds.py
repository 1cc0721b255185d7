"""The thesis's claims about the clouds: duplicates, elongation, counts (6.1.6, 6.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.thesis.claims.evidence import LEAST_CLOUDS, Evidence
from puckbench.thesis.claims.parts import Part, needs
from puckbench.thesis.claims.rates import TITLES, TWICE, WANTED
from puckbench.thesis.claims.roles import (
    ALL_ROOMS,
    CLASSICAL,
    DRACO,
    LEARNED,
    SCANS,
)
from puckbench.thesis.published_rates import OBJECTS, ROOMS

if TYPE_CHECKING:
    import pandas as pd

LEAST_ROOMS = 16
VISIBLE = 0.5
"""Rank correlation: a quarter of the variance, and with `LEAST_ROOMS` rooms just beyond chance
(5 %). Less does not show in a scatter plot, which is what the thesis looked at."""
MORE_DUPLICATES = 0.05
"""Of the points: with fewer more, duplicates cannot double the bits."""


def draco_shifted_by_duplicates(evidence: Evidence) -> list[Part]:
    """Claim 12: Draco's curve lies at more bits on scans because it keeps duplicate points.

    It does when at the first rate its median bits per point on every set of scans are more than
    twice (`TWICE`) those on objects; the thesis has 175 times. Duplicates explain it when at that
    rate the share of points that fall together is higher on scans by `MORE_DUPLICATES`.
    """
    if DRACO not in evidence.codecs:
        return [needs(WANTED[DRACO])]
    objects, scans = evidence.named(OBJECTS), evidence.named(*SCANS)
    if not objects or not scans:
        return [needs("an object set and scans")]
    if not evidence.enough_clouds((*objects, *scans), DRACO):
        return [needs(f"{LEAST_CLOUDS} clouds or more")]
    bpp = {name: evidence.rates(name, DRACO, "bpp") for name in (*objects, *scans)}
    highest = max(bpp[name][0] for name in objects)
    found = ", ".join(f"{name} {_ends(values)} bpp" for name, values in bpp.items())
    shifted = all(bpp[name][0] > TWICE * highest for name in scans)
    shares = {name: _coinciding(evidence, name) for name in bpp}
    sample = "" if evidence.of_medians else f"{evidence.clouds_of(bpp, DRACO)} clouds"
    parts = [Part("shifted to more bits on scans", shifted, found, sample=sample)]
    if any(np.isnan(share) for share in shares.values()):
        return [*parts, needs("counts of the decoded points")]
    most = max(shares[name] for name in objects)
    more = all(shares[name] > most + MORE_DUPLICATES for name in scans)
    found = ", ".join(f"{name} {share:.2%}" for name, share in shares.items())
    says = "more points fall together there at the first rate"
    return [*parts, Part(says, more, found, sample=sample)]


def elongation_has_no_effect(evidence: Evidence) -> list[Part]:
    """Claim 13: the elongation of a room has no visible effect.

    On sets of at least `LEAST_ROOMS` rooms, for each codec of the thesis, the median over the
    rates of Spearman's correlation between elongation and CD is below `VISIBLE` in size.
    """
    table = evidence.metrics
    rooms = [name for name in evidence.named(*ALL_ROOMS, *SCANS) if _clouds(table, name)]
    if table is None or not rooms or "elongation" not in table:
        return [needs(f"a set of {LEAST_ROOMS} rooms or more")]
    parts = []
    for role in (*CLASSICAL, *LEARNED):
        if role not in evidence.codecs:
            parts.append(needs(WANTED[role]))
            continue
        rows = table[table["codec"] == evidence.codecs[role]]
        found = {name: _correlation(rows[rows["dataset"] == name]) for name in rooms}
        text = ", ".join(f"{name} {value:+.2f}" for name, value in found.items())
        weak = all(abs(value) < VISIBLE for value in found.values())
        text = f"rank correlation with CD: {text}"
        sample = f"{evidence.clouds_of(rooms, role)} rooms, {rows['rate'].nunique()} rates"
        parts.append(Part(f"{TITLES[role]}: none", weak, text, sample=sample))
    return parts


def scans_have_alike_counts(evidence: Evidence) -> list[Part]:
    """Claim 14: scans have a narrower spread of point counts than raw rooms, and a higher median.

    The interquartile range of each set of scans is below that of the captured rooms, its median
    above. Rooms whose points were sampled have the count that was asked for, and do not count.
    """
    table = evidence.clouds
    counts = {} if table is None else dict(iter(table.groupby("dataset")["points"]))
    rooms = _of(evidence, counts, ROOMS)
    scans = _of(evidence, counts, *SCANS)
    if not rooms or not scans:
        return [needs("captured rooms as clouds (make: cloud) and their scans")]
    spread = {name: float(np.subtract(*counts[name].quantile([0.75, 0.25]))) for name in counts}
    median = {name: float(counts[name].median()) for name in counts}
    parts = []
    for raw in rooms:
        for name in scans:
            widths = f"interquartile ranges {spread[name]:,.0f} and {spread[raw]:,.0f} points"
            middle = f"medians {median[name]:,.0f} and {median[raw]:,.0f} points"
            narrower, higher = spread[name] < spread[raw], median[name] > median[raw]
            sample = f"{len(counts[name])} and {len(counts[raw])} clouds"
            parts.append(Part(f"{name} narrower than {raw}", narrower, widths, sample=sample))
            parts.append(Part(f"{name} higher than {raw}", higher, middle, sample=sample))
    return parts


def _of(evidence: Evidence, counts: dict[str, pd.Series[float]], *roles: str) -> list[str]:
    """Data sets of some kinds with clouds enough for quartiles."""
    return [
        name
        for name, role in evidence.datasets.items()
        if role in roles and len(counts.get(name, ())) >= LEAST_CLOUDS
    ]


def _clouds(table: pd.DataFrame | None, dataset: str) -> bool:
    """Whether a data set has rooms enough for a correlation."""
    if table is None:
        return False
    return int(table.loc[table["dataset"] == dataset, "cloud"].nunique()) >= LEAST_ROOMS


def _correlation(rows: pd.DataFrame) -> float:
    """Median over the rates of Spearman's correlation of elongation and CD; 0 for no spread."""
    each = [
        float(part[["elongation", "cd_plane"]].rank().corr().to_numpy(dtype=float)[0, 1])
        for _, part in rows.groupby("rate")
    ]
    known = [value for value in each if not np.isnan(value)]
    return float(np.median(known)) if known else 0.0


def _coinciding(evidence: Evidence, dataset: str) -> float:
    """Median share of Draco's points that lie on another, at its first rate; nan if unknown."""
    table = evidence.metrics
    if table is None or not {"points_b", "points_out"} <= set(table):
        return float("nan")
    medians = evidence.medians
    own = medians[(medians["dataset"] == dataset) & (medians["codec"] == DRACO)]
    rate = own.sort_values("number")["rate"].iloc[0]
    wanted = {"dataset": dataset, "codec": evidence.codecs[DRACO], "rate": rate}
    for name, value in wanted.items():
        table = table[table[name] == value]
    return float((1 - table["points_b"] / table["points_out"]).median())


def _ends(values: Floats) -> str:
    return f"{values[0]:.3g} to {values[-1]:.3g}"

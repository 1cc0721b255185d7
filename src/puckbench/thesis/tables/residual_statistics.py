"""Statistics of plane residuals per model, surface, distance and laser, with their uncertainty."""

from __future__ import annotations

from itertools import compress, product
from typing import TYPE_CHECKING

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.metrics.table_registry import SENSOR, TABLES
from puckbench.thesis.published import FAR_M

if TYPE_CHECKING:
    import pandas as pd

KEYS = ("model", "surface", "distance_m", "laser_id")
ALL = "all"
"""Stands in a key's column for all of its values together; for the distance, all below `FAR_M`."""

_PLACE = ("surface", "distance_m")
_SURFACES = ("wall", "floor")
_CONFIDENCE = 0.95


@TABLES.register("residual_statistics", title="Statistics of plane residuals", category=SENSOR)
def residual_statistics(residuals: pd.DataFrame) -> pd.DataFrame:
    """Statistics of the plane residuals (thesis procedure 1), in metres.

    One row per error model or capture ("real"), surface, distance of the sensor from the wall, and
    laser; "all" stands for all of them together, for the distance all nearer than 30 m.
    ``mean_half_m`` and ``std_half_m`` are half widths of 95 % intervals of mean and standard
    deviation, from the scatter of repeated ``scans`` (one surface in one run from one distance):
    within a scan the returns share the fitted plane and the biases of the lasers, so their
    ``count`` says little. A row without a repeated scan has none.

    Returns
    -------
    pd.DataFrame
        `KEYS` as text, ``count``, ``scans``, ``mean_m``, ``mean_half_m``, ``std_m`` (n - 1),
        ``std_half_m``, ``rms_m``, ``median_m``.
    """
    import pandas as pd

    table = residuals.astype({"residual_m": np.float64, "model": str, "surface": str})
    if table.empty:
        raise InputError("statistics need at least one residual")
    parts = [_grouped(table, chosen) for chosen in _choices()]
    return _as_text(pd.concat(parts, ignore_index=True))


def _choices() -> list[list[str]]:
    """Every set of keys that tells groups apart; the model always does."""
    others = KEYS[1:]
    masks = product((True, False), repeat=len(others))
    return [[KEYS[0], *compress(others, mask)] for mask in masks]


def _grouped(table: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    """Statistics of the groups that `keys` tell apart."""
    rows = table if "distance_m" in keys else table[table["distance_m"] < FAR_M]
    scans = list(dict.fromkeys([*keys, *_PLACE, "run"]))
    sums = rows.assign(square=rows["residual_m"] ** 2).groupby(scans, sort=False)
    cells = sums.agg(n=("residual_m", "size"), one=("residual_m", "sum"), two=("square", "sum"))
    result = _moments(cells.reset_index(), keys)
    result["median_m"] = rows.groupby(keys)["residual_m"].median()
    return result.reset_index()


def _moments(cells: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    """Moments of the groups from the sums of their scans, and how far repeated scans scatter."""
    places = list(dict.fromkeys([*keys, *_PLACE]))
    total = cells.groupby(keys)[["n", "one", "two"]].transform("sum")
    mean = total["one"] / total["n"]
    variance = (total["two"] / total["n"] - mean**2).clip(lower=0)
    # What each scan adds to the error of mean and variance, to the first order.
    off_mean = cells["one"] - mean * cells["n"]
    square = cells["two"] - 2 * mean * cells["one"] + mean**2 * cells["n"]
    off_variance = square - variance * cells["n"]
    alike = cells.groupby(places)["n"].transform("size")
    cells = cells.assign(
        off_mean=_scatter(off_mean, cells, places),
        off_variance=_scatter(off_variance, cells, places),
        scans=1,
        repeats=1 - 1 / alike,
    )
    columns = ["n", "one", "two", "off_mean", "off_variance", "scans", "repeats"]
    return _result(cells.groupby(keys)[columns].sum())


def _scatter(off: pd.Series[float], cells: pd.DataFrame, places: list[str]) -> pd.Series[float]:
    """Share of each scan in the variance of a sum over scans, repeated ones being alike.

    A scan without a repetition counts in full, as if its place had no error of its own.
    """
    groups = off.groupby([cells[name] for name in places])
    alike, centre = groups.transform("size"), groups.transform("mean")
    repeated = alike > 1
    factor = (alike / (alike - 1).where(repeated)).where(repeated, 1.0)
    return factor * (off - centre.where(repeated, 0.0)) ** 2


def _result(sums: pd.DataFrame) -> pd.DataFrame:
    import pandas as pd

    n, one, two, off_mean, off_variance, _, repeats = sums.to_numpy(dtype=np.float64).T
    mean = one / n
    with np.errstate(divide="ignore", invalid="ignore"):
        std = np.sqrt((two / n - mean**2).clip(min=0) * n / (n - 1))
        widen = _student(np.round(repeats)) / n
        std_half = widen * np.sqrt(off_variance) / (2 * std)
    numbers = {
        "count": sums["n"],
        "scans": sums["scans"],
        "mean_m": mean,
        "mean_half_m": widen * np.sqrt(off_mean),
        "std_m": std,
        "std_half_m": std_half,
        "rms_m": np.sqrt(two / n),
    }
    return pd.DataFrame(numbers, index=sums.index)


def _student(freedom: Floats) -> Floats:
    """Quantile of Student's t for each number of degrees of freedom; nan for zero."""
    from scipy.special import stdtrit

    return np.asarray(stdtrit(np.where(freedom > 0, freedom, np.nan), (1 + _CONFIDENCE) / 2))


def _as_text(table: pd.DataFrame) -> pd.DataFrame:
    """Keys as text, groups of all after the single ones."""
    import pandas as pd

    orders = {"model": dict.fromkeys(table["model"]), "surface": _SURFACES}
    for name, order in orders.items():
        known = [*order, *sorted(set(table[name].dropna()) - set(order))]
        table[name] = pd.Categorical(table[name], categories=known)
    ordered = table.sort_values(list(KEYS)).astype(dict.fromkeys(orders, object))
    for name in ("distance_m", "laser_id"):
        ordered[name] = [ALL if np.isnan(value) else f"{value:g}" for value in ordered[name]]
    ordered["surface"] = ordered["surface"].fillna(ALL)
    return ordered[[*KEYS, *(name for name in ordered if name not in KEYS)]].reset_index(drop=True)

"""Statistics of plane residuals per model, surface, distance and laser, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import pandas as pd

from puckbench.analysis.published import FAR_M
from puckbench.cloud import Floats
from puckbench.errors import InputError

KEYS = ("model", "surface", "distance_m", "laser_id")
ALL = "all"
"""Stands in a key's column for all of its values together; for the distance, all below `FAR_M`."""

_SCAN = ("model", "surface", "distance_m", "run")
_RANKS = {"wall": 0, "floor": 1}
_CONFIDENCE = 0.95


def residual_statistics(residuals: pd.DataFrame) -> pd.DataFrame:
    """One row per model, surface, distance and laser of a residual table, and for all of each.

    Columns: `KEYS` as text, ``count``, ``scans``, ``mean_m``, ``mean_half_m``, ``std_m`` (n - 1),
    ``std_half_m``, ``rms_m``, ``median_m``. The half widths are those of 95 % intervals, from the
    scatter between the ``scans`` (one surface in one run) that the row is taken from: within one,
    returns share the fitted plane and the biases of the lasers, so their number says little. A row
    of a single scan has none.
    """
    table = residuals.astype({"residual_m": np.float64, "model": str, "surface": str})
    if table.empty:
        raise InputError("statistics need at least one residual")
    parts = [_grouped(table, chosen) for chosen in _choices()]
    return _as_text(pd.concat(parts, ignore_index=True))


def _choices() -> list[tuple[str, ...]]:
    """Every set of keys that tells groups apart; the model always does."""
    others = KEYS[1:]
    masks = product((True, False), repeat=len(others))
    return [(KEYS[0], *(key for key, on in zip(others, mask, strict=True) if on)) for mask in masks]


def _grouped(table: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """Statistics of the groups that `keys` tell apart."""
    rows = table if "distance_m" in keys else table[table["distance_m"] < FAR_M]
    scans = list(dict.fromkeys([*keys, *_SCAN]))
    residual = rows["residual_m"]
    sums = rows.assign(square=residual**2).groupby(scans, sort=False)
    cells = sums.agg(n=("residual_m", "size"), one=("residual_m", "sum"), two=("square", "sum"))
    result = _moments(cells.reset_index(), keys)
    result["median_m"] = rows.groupby(list(keys))["residual_m"].median()
    return result.reset_index()


def _moments(cells: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """Moments of the groups from the sums of their scans, and how far the scans scatter."""
    groups = cells.groupby(list(keys))
    total = groups[["n", "one", "two"]].transform("sum")
    mean = total["one"] / total["n"]
    variance = (total["two"] / total["n"] - mean**2).clip(lower=0)
    # What each scan adds to the error of mean and variance (linearised, scans independent).
    off_mean = cells["one"] - mean * cells["n"]
    square = cells["two"] - 2 * mean * cells["one"] + mean**2 * cells["n"]
    off_variance = square - variance * cells["n"]
    cells = cells.assign(off_mean=off_mean**2, off_variance=off_variance**2)
    sums = cells.groupby(list(keys))[["n", "one", "two", "off_mean", "off_variance"]].sum()
    return _result(sums, groups.size())


def _result(sums: pd.DataFrame, scans: pd.Series[int]) -> pd.DataFrame:
    n, one, two, off_mean, off_variance = sums.to_numpy(dtype=np.float64).T
    mean, k = one / n, np.asarray(scans, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        std = np.sqrt((two / n - mean**2).clip(min=0) * n / (n - 1))
        widen = _student(k) * np.sqrt(k / (k - 1)) / n
        std_half = widen * np.sqrt(off_variance) / (2 * std)
    numbers = {
        "mean_m": mean,
        "mean_half_m": widen * np.sqrt(off_mean),
        "std_m": std,
        "std_half_m": std_half,
        "rms_m": np.sqrt(two / n),
    }
    return pd.DataFrame({"count": sums["n"], "scans": scans, **numbers}, index=sums.index)


def _student(scans: Floats) -> Floats:
    """Quantile of Student's t with one degree of freedom less than scans; nan for one scan."""
    from scipy.special import stdtrit

    return np.asarray(stdtrit(scans - 1, (1 + _CONFIDENCE) / 2))


def _as_text(table: pd.DataFrame) -> pd.DataFrame:
    """Keys as text, groups of all after the single ones."""
    models = {name: place for place, name in enumerate(dict.fromkeys(table["model"]))}
    ranks = {"model": models, "surface": _RANKS}
    ordered = table.sort_values(
        list(KEYS), key=lambda keys: keys.map(ranks.get(str(keys.name), lambda value: value))
    )
    for name in ("distance_m", "laser_id"):
        ordered[name] = [ALL if np.isnan(value) else f"{value:g}" for value in ordered[name]]
    ordered["surface"] = ordered["surface"].fillna(ALL)
    return ordered[[*KEYS, *(name for name in ordered if name not in KEYS)]].reset_index(drop=True)

from __future__ import annotations

from itertools import compress, product
from typing import TYPE_CHECKING

import numpy as np

from jenco2022.published import FAR_M
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.results.columns import Column
from puckbench.tables.registry import SENSOR, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

KEYS = ("model", "surface", "distance_m", "laser_id")
ALL = "all"
"""Value of a key in rows that combine all values of the key. For distances, these are all distances
below `FAR_M`.
"""

_PLACE = ("surface", "distance_m")
_SURFACES = ("wall", "floor")
_CONFIDENCE = 0.95


_TOO_FEW = "too few residuals, or no repeated scans"
_COLUMNS = (
    Column("surface", "Surface"),
    Column("distance_m", "Distance", "m"),
    Column("laser_id", "Laser"),
    Column("scans", "Scans", bookkeeping=True),
    Column("mean_m", "Mean", "m", missing=_TOO_FEW),
    Column("std_m", "Std", "m", missing=_TOO_FEW),
    Column("rms_m", "RMS", "m"),
    Column("median_m", "Median", "m"),
)


@TABLES.register(
    "residual_statistics",
    title="Statistics of plane residuals",
    category=SENSOR,
    columns=_COLUMNS,
)
def residual_statistics(residuals: pd.DataFrame) -> pd.DataFrame:
    """Statistics of the plane residuals (thesis procedure 1), in metres.

    There is a row for each error model ("real" for captures), surface, distance from the wall, and
    laser. The value "all" combines surfaces, lasers, or distances below 30 m. ``mean_half_m`` and
    ``std_half_m`` are half widths of 95 % intervals. They come from repeated ``scans``, because the
    returns of one scan share a plane and the lasers' biases.
    """
    import pandas as pd

    table = residuals.astype({"residual_m": np.float64, "model": str, "surface": str})
    if table.empty:
        raise InputError("statistics need at least one residual")
    parts = [_grouped(table, keys) for keys in _key_sets()]
    return _as_text(pd.concat(parts, ignore_index=True))


def _key_sets() -> list[list[str]]:
    others = KEYS[1:]
    masks = product((True, False), repeat=len(others))
    return [[KEYS[0], *compress(others, mask)] for mask in masks]


def _grouped(table: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    rows = table if "distance_m" in keys else table[table["distance_m"] < FAR_M]
    scans = list(dict.fromkeys([*keys, *_PLACE, "run"]))
    groups = rows.assign(square=rows["residual_m"] ** 2).groupby(scans, sort=False)
    sums = groups.agg(n=("residual_m", "size"), one=("residual_m", "sum"), two=("square", "sum"))
    result = _moments(sums.reset_index(), keys)
    result["median_m"] = rows.groupby(keys)["residual_m"].median()
    return result.reset_index()


def _moments(scans: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    places = list(dict.fromkeys([*keys, *_PLACE]))
    total = scans.groupby(keys)[["n", "one", "two"]].transform("sum")
    mean = total["one"] / total["n"]
    variance = (total["two"] / total["n"] - mean**2).clip(lower=0)
    # First-order contributions of each scan to the errors of mean and variance.
    mean_error = scans["one"] - mean * scans["n"]
    square = scans["two"] - 2 * mean * scans["one"] + mean**2 * scans["n"]
    variance_error = square - variance * scans["n"]
    repeats = scans.groupby(places)["n"].transform("size")
    scans = scans.assign(
        mean_error_sq=_scatter(mean_error, scans, places),
        variance_error_sq=_scatter(variance_error, scans, places),
        scans=1,
        freedom=1 - 1 / repeats,
    )
    columns = ["n", "one", "two", "mean_error_sq", "variance_error_sq", "scans", "freedom"]
    return _result(scans.groupby(keys)[columns].sum())


def _scatter(errors: pd.Series[float], scans: pd.DataFrame, places: list[str]) -> pd.Series[float]:
    """Return each scan's contribution to the variance of the sum of `errors`.

    Deviations are from the mean over scans of the same place or, for a single scan, from zero.
    """
    groups = errors.groupby([scans[name] for name in places])
    repeats, centre = groups.transform("size"), groups.transform("mean")
    repeated = repeats > 1
    factor = (repeats / (repeats - 1).where(repeated)).where(repeated, 1.0)
    return factor * (errors - centre.where(repeated, 0.0)) ** 2


def _result(sums: pd.DataFrame) -> pd.DataFrame:
    import pandas as pd

    n, total, total_of_squares, mean_error_sq, variance_error_sq, _, freedom = sums.to_numpy(
        dtype=np.float64
    ).T
    mean = total / n
    with np.errstate(divide="ignore", invalid="ignore"):
        std = np.sqrt((total_of_squares / n - mean**2).clip(min=0) * n / (n - 1))
        factor = _student_quantile(np.round(freedom)) / n
        std_half = factor * np.sqrt(variance_error_sq) / (2 * std)
    numbers = {
        "count": sums["n"],
        "scans": sums["scans"],
        "mean_m": mean,
        "mean_half_m": factor * np.sqrt(mean_error_sq),
        "std_m": std,
        "std_half_m": std_half,
        "rms_m": np.sqrt(total_of_squares / n),
    }
    return pd.DataFrame(numbers, index=sums.index)


def _student_quantile(freedom: Floats) -> Floats:
    from scipy.special import stdtrit

    return np.asarray(stdtrit(np.where(freedom > 0, freedom, np.nan), (1 + _CONFIDENCE) / 2))


def _as_text(table: pd.DataFrame) -> pd.DataFrame:
    import pandas as pd

    orders = {"model": dict.fromkeys(table["model"]), "surface": _SURFACES}
    for name, order in orders.items():
        categories = [*order, *sorted(set(table[name].dropna()) - set(order))]
        table[name] = pd.Categorical(table[name], categories=categories)
    ordered = table.sort_values(list(KEYS)).astype(dict.fromkeys(orders, object))
    for name in ("distance_m", "laser_id"):
        ordered[name] = [ALL if np.isnan(value) else f"{value:g}" for value in ordered[name]]
    ordered["surface"] = ordered["surface"].fillna(ALL)
    return ordered[[*KEYS, *(name for name in ordered if name not in KEYS)]].reset_index(drop=True)

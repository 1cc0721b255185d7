from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

BINS = 10
_QUARTILES = (0.25, 0.5, 0.75)


class Curve(NamedTuple):
    """The median of x, and the median and quartiles of y, for each bin or rate."""

    x: Floats
    y: Floats
    low: Floats
    high: Floats


def equal_count_medians(x: Floats, y: Floats, bins: int = BINS) -> Curve:
    """Return medians of x and y in at most `bins` equally filled bins of x.

    The edges are quantiles of x. Pairs that contain nan are ignored.
    """
    import pandas as pd

    paired = np.isfinite(x) & np.isfinite(y)
    frame = pd.DataFrame({"x": x[paired], "y": y[paired]})
    if frame["x"].nunique() <= bins:
        bin_of = frame["x"].rank(method="dense")
    else:
        bin_of = pd.qcut(frame["x"], bins, labels=False, duplicates="drop")
    return _curve(frame, bin_of)


def medians_against(rows: pd.DataFrame, x: str, y: str) -> Curve:
    """Return medians of column `y` against `x` for a codec's rows on a data set, by increasing x.

    With fewer than `BINS` clouds, medians are per rate, because bins would mix rates.
    """
    if rows["cloud"].nunique() >= BINS:
        return equal_count_medians(rows[x].to_numpy(float), rows[y].to_numpy(float))
    frame = rows[[x, y]].rename(columns={x: "x", y: "y"}).astype(float)
    return _curve(frame, rows["rate"].astype(str))


def _curve(frame: pd.DataFrame, keys: pd.Series[Any]) -> Curve:
    groups = frame.groupby(keys)
    columns = [groups["x"].median(), *(groups["y"].quantile(q) for q in _QUARTILES)]
    order = np.argsort(columns[0].to_numpy(), kind="stable")
    x, low, y, high = (column.to_numpy(float)[order] for column in columns)
    return Curve(x, y, low, high)


def medians_per_rate(table: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return medians of a column by ``dataset``, ``codec`` and ``rate``, without missing values.

    Columns ``low`` and ``high`` contain the quartiles.
    """
    present = table.dropna(subset=[column])
    groups = present.groupby(["dataset", "codec", "rate"], observed=True)[column]
    low, medians, high = (groups.quantile(q) for q in _QUARTILES)
    return medians.reset_index().assign(low=low.to_numpy(), high=high.to_numpy())


def ordered_rates(rates: set[str]) -> list[str]:
    """Return rates sorted by the number in their names: r2 before r10, 0.5mm before 2mm."""
    return sorted(rates, key=lambda rate: (*map(float, re.findall(r"\d+(?:\.\d+)?", rate)), rate))

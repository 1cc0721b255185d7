from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pointkit.geometry.cloud import Floats
from puckbench.metrics.statistics import MIN_SCENES, SCENE, with_scenes

if TYPE_CHECKING:
    import pandas as pd

BINS = 10
_QUARTILES = (0.25, 0.5, 0.75)


class Curve(NamedTuple):
    """A line of a figure: medians over clouds, with their spread.

    Parameters
    ----------
    x
        Median of x in each of k bins, or at each of k rates, (k,).
    y
        Median of y, (k,).
    low, high
        Lower and upper quartile of y, (k,); nan with fewer than `MIN_SCENES` scenes.
    singles
        With fewer than `MIN_SCENES` scenes, x and y of every result, (n, 2); otherwise empty.
    """

    x: Floats
    y: Floats
    low: Floats
    high: Floats
    singles: Floats = np.empty((0, 2))


def equal_count_medians(x: Floats, y: Floats, bins: int = BINS) -> Curve:
    """Sort pairs of x and y into bins with equally many pairs, and return the medians of the bins.

    The edges of the bins are quantiles of x. Pairs that contain nan are ignored.

    Parameters
    ----------
    x, y
        Values, (n,).
    bins
        Largest number of bins.

    Returns
    -------
    Curve
        Medians by increasing x, with quartiles of bins that have at least `MIN_SCENES` values.
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
    """Return medians of one column of results against another column.

    Parameters
    ----------
    rows
        Results of one codec on one data set.
    x, y
        Names of the two columns.

    Returns
    -------
    Curve
        Medians by increasing x: in bins with equally many results or, with fewer than `BINS`
        clouds, at each rate, because bins of few clouds would mix rates.
    """
    frame = rows[[x, y]].set_axis(["x", "y"], axis=1).astype(float)
    if rows["cloud"].nunique() >= BINS:
        curve = equal_count_medians(frame["x"].to_numpy(), frame["y"].to_numpy())
    else:
        curve = _curve(frame, rows["rate"].astype(str))
    return _with_spread(curve, rows, frame)


def medians_per_rate(rows: pd.DataFrame, y: str, rates: Sequence[str]) -> Curve:
    """Return the median of a column of results at each rate.

    Parameters
    ----------
    rows
        Results of one codec on one data set.
    y
        Name of the column.
    rates
        Names of the rates, in the order of the figure.

    Returns
    -------
    Curve
        x are the places 0, 1, ... of the rates in `rates`; y is nan at rates without values.
    """
    import pandas as pd

    rows = rows[rows["rate"].isin(rates)].dropna(subset=[y])
    places = rows["rate"].map({rate: float(place) for place, rate in enumerate(rates)})
    frame = pd.DataFrame({"x": places.astype(float), "y": rows[y].astype(float)})
    curve = _curve(frame, frame["x"])
    values = np.full((3, len(rates)), np.nan)
    values[:, curve.x.astype(int)] = curve.y, curve.low, curve.high
    return _with_spread(Curve(np.arange(len(rates), dtype=float), *values), rows, frame)


def _with_spread(curve: Curve, rows: pd.DataFrame, frame: pd.DataFrame) -> Curve:
    if with_scenes(rows)[SCENE].nunique() >= MIN_SCENES:
        return curve
    unknown = np.full_like(curve.y, np.nan)
    singles = frame.to_numpy() if rows["cloud"].nunique() > 1 else np.empty((0, 2))
    return Curve(curve.x, curve.y, unknown, unknown, singles)


def _curve(frame: pd.DataFrame, keys: pd.Series[Any]) -> Curve:
    groups = frame.groupby(keys)
    columns = [groups["x"].median(), *(groups["y"].quantile(q) for q in _QUARTILES)]
    order = np.argsort(columns[0].to_numpy(), kind="stable")
    x, low, y, high = (column.to_numpy(float)[order] for column in columns)
    has_spread = groups.size().to_numpy()[order] >= MIN_SCENES
    return Curve(x, y, np.where(has_spread, low, np.nan), np.where(has_spread, high, np.nan))


def ordered_rates(rates: Iterable[str]) -> list[str]:
    """Return the names of rates, sorted by the numbers in them: r2 before r10, 0.5mm before 2mm."""
    numbers = {rate: tuple(map(float, re.findall(r"\d+(?:\.\d+)?", rate))) for rate in rates}
    return sorted(numbers, key=lambda rate: (numbers[rate], rate))

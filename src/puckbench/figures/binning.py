"""Medians of a metric: per rate (thesis Figure 6.5) and against bpp (Figures 6.6 to 6.9)."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

BINS = 10


def equal_count_medians(x: Floats, y: Floats, bins: int = BINS) -> tuple[Floats, Floats]:
    """Medians of x and of y in bins of x that hold equal numbers of values.

    Parameters
    ----------
    x, y
        (n,) float; pairs of which one is missing (nan) are left out.
    bins
        Number of bins at most. Their edges are the quantiles of x (as ``pandas.qcut``); with no
        more distinct values than bins each value has a bin of its own.

    Returns
    -------
    x, y
        (m,) float medians, by rising x.
    """
    import pandas as pd

    paired = np.isfinite(x) & np.isfinite(y)
    frame = pd.DataFrame({"x": x[paired], "y": y[paired]})
    if frame["x"].nunique() <= bins:
        bin_of = frame["x"].rank(method="dense")
    else:
        bin_of = pd.qcut(frame["x"], bins, labels=False, duplicates="drop")
    medians = frame.groupby(bin_of).median().sort_index()
    return medians["x"].to_numpy(), medians["y"].to_numpy()


def medians_against(rows: pd.DataFrame, x: str, y: str) -> tuple[Floats, Floats]:
    """Medians of two columns of one codec on one data set.

    The bins are the thesis's. With fewer clouds than bins, a bin would hold one rate of some clouds
    and another rate of the others, so that the line would follow the clouds: then each rate has a
    median.

    Parameters
    ----------
    rows
        Result rows of one codec and data set.
    x, y
        Columns.

    Returns
    -------
    x, y
        (m,) float medians, by rising x.
    """
    if rows["cloud"].nunique() >= BINS:
        return equal_count_medians(rows[x].to_numpy(float), rows[y].to_numpy(float))
    medians = rows.groupby("rate", observed=True)[[x, y]].median().sort_values(x)
    return medians[x].to_numpy(float), medians[y].to_numpy(float)


def medians_per_rate(table: pd.DataFrame, column: str) -> pd.DataFrame:
    """Median of a column over the clouds of each data set, codec and rate.

    Parameters
    ----------
    table
        Result rows.
    column
        What is measured; rows without a value are left out.

    Returns
    -------
    pd.DataFrame
        Columns ``dataset``, ``codec``, ``rate`` and the one given.
    """
    present = table.dropna(subset=[column])
    medians = present.groupby(["dataset", "codec", "rate"], observed=True)[column].median()
    return medians.reset_index()


def ordered_rates(rates: set[str]) -> list[str]:
    """Rates in the order of their numbers: r2 before r10."""
    return sorted(rates, key=lambda rate: (*map(int, re.findall(r"\d+", rate)), rate))

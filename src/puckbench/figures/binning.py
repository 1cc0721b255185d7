"""Medians of a metric by rate (thesis figure 6.5) and by bits per point (figures 6.6 to 6.9)."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

BINS = 10


def equal_count_medians(x: Floats, y: Floats, bins: int = BINS) -> tuple[Floats, Floats]:
    """Return medians of x and y in at most `bins` bins of x with equal numbers of values.

    The edges are quantiles of x. Pairs that contain nan are ignored.
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
    """Return medians of x and y for a codec's rows on a data set, by increasing x.

    With fewer than `BINS` clouds, medians are per rate, because bins would mix rates.
    """
    if rows["cloud"].nunique() >= BINS:
        return equal_count_medians(rows[x].to_numpy(float), rows[y].to_numpy(float))
    medians = rows.groupby("rate", observed=True)[[x, y]].median().sort_values(x)
    return medians[x].to_numpy(float), medians[y].to_numpy(float)


def medians_per_rate(table: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return medians of a column by ``dataset``, ``codec`` and ``rate``, without missing values."""
    present = table.dropna(subset=[column])
    medians = present.groupby(["dataset", "codec", "rate"], observed=True)[column].median()
    return medians.reset_index()


def ordered_rates(rates: set[str]) -> list[str]:
    """Return rates sorted by the number in their names: r2 before r10, 0.5mm before 2mm."""
    return sorted(rates, key=lambda rate: (*map(float, re.findall(r"\d+(?:\.\d+)?", rate)), rate))

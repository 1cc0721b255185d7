"""Selection of the measured times that are reliable enough for rankings."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

MIN_REPEATS = 3
"""Minimum number of timed calls: the median of three is robust to one disturbed call."""


def ranked_rows(metrics: pd.DataFrame) -> pd.Series[bool]:
    """Return a mask of the results whose times can be ranked.

    They were timed at least `MIN_REPEATS` times while no other job ran.
    """
    rows = metrics.reindex(columns=["timed_alone", "repeats"])
    return rows["timed_alone"].eq(True) & (rows["repeats"].fillna(1) >= MIN_REPEATS)


def unranked_codecs(metrics: pd.DataFrame) -> set[str]:
    """Return the names of codecs that have a result whose times cannot be ranked."""
    return set(metrics.loc[~ranked_rows(metrics), "codec"])

from __future__ import annotations

from typing import TYPE_CHECKING

from pointkit.errors import InputError
from pointkit.geometry.cloud import CoordinateFrame
from puckbench.results.columns import FRAME

if TYPE_CHECKING:
    import pandas as pd


def frames_of(table: pd.DataFrame) -> set[str]:
    """Return the coordinate frames that occur in a table: "metric", "scaled", or both."""
    return set(table[FRAME].fillna("scaled")) if FRAME in table else {"scaled"}


def rows_in_frame(table: pd.DataFrame, frame: CoordinateFrame) -> pd.DataFrame:
    """Return the rows of a table that belong to clouds in one coordinate frame.

    Without the column `FRAME`, all rows belong to scaled clouds. For clouds in metres, columns
    without any value are removed.

    Parameters
    ----------
    table
        Table of clouds or results.
    frame
        "metric" for clouds in metres, "scaled" for clouds scaled to a fixed range.
    """
    if FRAME not in table:
        return table if frame == "scaled" else table.iloc[:0]
    rows = table[(table[FRAME] == "metric") == (frame == "metric")]
    return rows.dropna(axis="columns", how="all") if frame == "metric" else rows


def rows_in_metres(metrics: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a results table that belong to clouds in metres.

    Raises InputError if there are none.
    """
    rows = rows_in_frame(metrics, "metric")
    if rows.empty:
        raise InputError("metrics table: no results of clouds in metres")
    return rows

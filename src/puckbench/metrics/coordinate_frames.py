from __future__ import annotations

from typing import TYPE_CHECKING

from pointkit.errors import InputError
from pointkit.geometry.cloud import CoordinateFrame

if TYPE_CHECKING:
    import pandas as pd

FRAME = "frame"
"""Column of tables of clouds and results: "metric" (metres), or empty for scaled clouds."""


def frames_of(table: pd.DataFrame) -> set[str]:
    """Return the coordinate frames of a table's rows."""
    return set(table[FRAME].fillna("scaled")) if FRAME in table else {"scaled"}


def rows_in_frame(table: pd.DataFrame, frame: CoordinateFrame) -> pd.DataFrame:
    """Return the rows of clouds in a coordinate frame; without column `FRAME`, all are scaled."""
    if FRAME not in table:
        return table if frame == "scaled" else table.iloc[:0]
    rows = table[(table[FRAME] == "metric") == (frame == "metric")]
    return rows.dropna(axis="columns", how="all") if frame == "metric" else rows


def rows_in_metres(metrics: pd.DataFrame) -> pd.DataFrame:
    """Return the result rows of clouds in metres; raise InputError if there are none."""
    rows = rows_in_frame(metrics, "metric")
    if rows.empty:
        raise InputError("metrics table: no results of clouds in metres")
    return rows

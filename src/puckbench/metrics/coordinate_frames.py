"""Rows of tables by the frame of their clouds: scaled to a cube, or in metres."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.geometry.cloud import CoordinateFrame

if TYPE_CHECKING:
    import pandas as pd

FRAME = "frame"
"""Column of tables of clouds and results: empty for scaled clouds, absent if all are scaled."""


def in_frame(table: pd.DataFrame, frame: CoordinateFrame) -> pd.DataFrame:
    """The rows whose clouds are in a frame; a table without the column is of scaled clouds."""
    if FRAME not in table:
        return table if frame == "scaled" else table.iloc[:0]
    rows = table[(table[FRAME] == "metric") == (frame == "metric")]
    return rows.dropna(axis="columns", how="all") if frame == "metric" else rows

"""Tables of several models and captures as one, each under the name a configuration gives it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from puckbench.core.errors import InputError
from puckbench.core.seeding import generator

COLUMNS = {
    "residuals": (
        "model",
        "surface",
        "distance_m",
        "run",
        "laser_id",
        "elevation_deg",
        "residual_m",
        "incidence_rad",
    ),
    "scans": (
        "model",
        "surface",
        "distance_m",
        "laser_id",
        "elevation_deg",
        "x_m",
        "y_m",
        "z_m",
        "range_error_m",
        "incidence_rad",
    ),
}
"""Columns of a table of residuals and of one of points that figures and statistics ask for."""

MOST_ROWS = 500_000
"""Rows of one table that are kept at most, chosen at random: captures can be of any length."""


def joined_files(files: Sequence[tuple[str, Path]], kind: str) -> pd.DataFrame:
    """Parquet tables one after the other, with the columns of a kind of `COLUMNS`.

    files: the name that stands in column ``model``, and the table. InputError names a table
    without one of the columns.
    """
    whole = pd.concat([_part(*file, COLUMNS[kind]) for file in files], ignore_index=True)
    return whole.astype({"model": "category", "surface": "category"})


def _part(name: str, path: Path, columns: Sequence[str]) -> pd.DataFrame:
    table = pd.read_parquet(path)
    if missing := [column for column in columns if column not in table]:
        raise InputError(f"{path}: no column {missing[0]!r}")
    kept = subsampled(table, MOST_ROWS, name)
    return kept.assign(model=name)[list(columns)].astype({"surface": str})


def subsampled(table: pd.DataFrame, most: int, name: str) -> pd.DataFrame:
    """At most `most` rows in their order, chosen at random, the same for the same name."""
    if len(table) <= most:
        return table
    return table.sample(most, random_state=generator(0, "joined", name)).sort_index()

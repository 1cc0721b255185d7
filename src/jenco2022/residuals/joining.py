from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pointkit.errors import InputError
from pointkit.seeding import generator

COLUMNS = {
    "residuals": (
        *("model", "surface", "distance_m", "run", "laser_id", "elevation_deg"),
        *("residual_m", "incidence_rad"),
    ),
    "scans": (
        *("model", "surface", "distance_m", "laser_id", "elevation_deg", "x_m", "y_m", "z_m"),
        *("range_error_m", "incidence_rad"),
    ),
}
"""Columns of joined tables, by kind, that figures and statistics use."""

MAX_ROWS = 500_000
"""Maximum number of random rows kept of each table, since captures can have any length."""


def joined_files(files: Sequence[tuple[str, Path]], kind: str) -> pd.DataFrame:
    """Concatenate the columns ``COLUMNS[kind]`` of Parquet tables.

    `files` are pairs of an error model's name and a path. Raises InputError if a column is missing.
    """
    table = pd.concat([_part(*file, COLUMNS[kind]) for file in files], ignore_index=True)
    return table.astype({"model": "category", "surface": "category"})


def _part(name: str, path: Path, columns: Sequence[str]) -> pd.DataFrame:
    table = pd.read_parquet(path)
    if missing := [column for column in columns if column not in table]:
        raise InputError(f"{path}: no column {missing[0]!r}")
    rows = subsampled(table, MAX_ROWS, name)
    return rows.assign(model=name)[list(columns)].astype({"surface": str})


def subsampled(table: pd.DataFrame, max_rows: int, name: str) -> pd.DataFrame:
    """Return at most `max_rows` random rows in their original order; `name` determines the seed."""
    if len(table) <= max_rows:
        return table
    return table.sample(max_rows, random_state=generator(0, "joined", name)).sort_index()

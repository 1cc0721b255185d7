"""Reading and writing tables: CSV for people, Parquet for programs."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable, written_whole
from puckbench.io.parquet_rows import check_rows

_NAMES = ("dataset", "cloud", "group", "codec", "rate")
"""Columns that are read as text even where they look like numbers."""


def read_table(path: Path) -> pd.DataFrame:
    """A table of CSV or Parquet; InputError when it cannot be read or has no rows."""
    try:
        if path.suffix == ".parquet":
            check_rows(path)
            table = pd.read_parquet(path)
        else:
            table = pd.read_csv(path, dtype=dict.fromkeys(_NAMES, "str"))
    except OSError as error:
        raise unreadable(path, error) from error
    except (ValueError, NotImplementedError, LookupError, TypeError, AttributeError) as error:
        fault = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(f"{path}: not a readable table ({fault})") from error
    if len(table) == 0:
        raise InputError(f"{path}: the table has no rows")
    return table


def write_table(table: pd.DataFrame, *paths: Path) -> None:
    """Write the table as CSV and as Parquet, by the suffix of each path, whole or not at all."""
    for path in paths:
        with written_whole(path) as temporary:
            if path.suffix == ".parquet":
                table.to_parquet(temporary, compression="zstd", index=False)
            else:
                table.to_csv(temporary, index=False)

"""Tables in CSV and Parquet files, read and written as pandas data frames."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from pointkit.column_tables import check_parquet_memory
from pointkit.damage import reading
from pointkit.errors import InputError, naming
from pointkit.files import refuse_special, unreadable, written_whole

_TEXT_COLUMNS = ("dataset", "cloud", "scene", "group", "codec", "rate")
_DAMAGE = (ValueError, NotImplementedError, LookupError, TypeError, AttributeError)


def read_table(path: Path) -> pd.DataFrame:
    """Read a CSV file, or a Parquet file if the suffix is ``.parquet``, as a data frame.

    Raises InputError if the file is missing or damaged, has no rows, or takes too much memory for
    its size.
    """
    try:
        with naming(path), reading("table", *_DAMAGE):
            table = _read(path)
    except OSError as error:
        raise unreadable(path, error) from error
    if len(table) == 0:
        raise InputError(f"{path}: the table has no rows")
    return table


def check_columns(table: pd.DataFrame, texts: Iterable[str], numbers: Iterable[str] = ()) -> None:
    """Raise InputError unless a table has certain columns.

    Parameters
    ----------
    table
        The table.
    texts
        Names of the columns that must exist with texts.
    numbers
        Names of the columns that must exist with numbers.
    """
    for name in (*texts, *numbers):
        if name not in table:
            raise InputError(f"no column {name!r}")
    for name in texts:
        if not all(isinstance(value, str) for value in table[name]):
            raise InputError(f"column {name!r} is not text")
    for name in numbers:
        if not is_number_column(table[name]):
            raise InputError(f"column {name!r} is not numbers")


def is_number_column(values: pd.Series[Any]) -> bool:
    """Return whether every value of a column is a number or missing."""
    return bool(pd.api.types.is_numeric_dtype(values) or values.isna().all())


def write_table(table: pd.DataFrame, *paths: Path) -> None:
    """Write a table to each of the given files, as Parquet or CSV by the suffix of the file.

    The suffix ``.parquet`` selects Parquet, any other suffix CSV. Each file appears only when it is
    complete.
    """
    for path in paths:
        with written_whole(path) as temporary:
            if path.suffix == ".parquet":
                table.to_parquet(temporary, compression="zstd", index=False)
            else:
                table.to_csv(temporary, index=False)


def _read(path: Path) -> pd.DataFrame:
    if path.suffix == ".parquet":
        check_parquet_memory(path)
        return pd.read_parquet(path)
    refuse_special(path)
    return pd.read_csv(path, dtype=dict.fromkeys(_TEXT_COLUMNS, "str"))

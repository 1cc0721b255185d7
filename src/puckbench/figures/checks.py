from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


def require_rows(table: pd.DataFrame, columns: tuple[str, ...], what: str) -> None:
    """Check that a table can be drawn.

    Parameters
    ----------
    table
        The table.
    columns
        Columns that are drawn.
    what
        Name of the table in the error message.

    Raises
    ------
    InputError
        The table has no rows, lacks a column, or has a column without values.
    """
    missing = [name for name in columns if name not in table.columns]
    if missing:
        raise InputError(f"{what} table: no column {missing[0]!r}")
    if len(table) == 0:
        raise InputError(f"{what} table: no rows, nothing to draw")
    for name in columns:
        if table[name].isna().all():
            raise InputError(f"{what} table: no value in column {name!r}")


def require_numbers(table: pd.DataFrame, columns: tuple[str, ...], what: str) -> None:
    """Check that columns of a table contain numbers that can be drawn.

    Parameters
    ----------
    table
        The table.
    columns
        Columns that are drawn.
    what
        Name of the table in the error message.

    Raises
    ------
    InputError
        A column contains text, or a negative or infinite number.
    """
    for name in columns:
        if table[name].dtype.kind not in "fiu":
            raise InputError(f"{what} table: column {name!r} has values that are not numbers")
        values = table[name].to_numpy(dtype=float)
        if np.isinf(values).any() or (values < 0).any():
            raise InputError(f"{what} table: column {name!r} has a negative or infinite value")

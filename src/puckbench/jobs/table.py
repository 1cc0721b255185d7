"""One table: from input files to a file, as the workflow and the command line make it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.io.tables import read_table, write_table
from puckbench.metrics.registry import TableEntry, table_entry

_DIGITS = 6
"""Significant digits of a table's numbers: more than any measurement here has."""


def make_table(
    name: str, inputs: Mapping[str, Path], options: Mapping[str, Any], outputs: Sequence[Path]
) -> int:
    """Make a registered table from files into files.

    Parameters
    ----------
    name
        Of the table, or ``path/to/file.py:function``.
    inputs
        File (CSV or Parquet) of each input by its name; others are ignored.
    options
        Further arguments of the table's function.
    outputs
        Paths that end in .csv or .parquet.

    Returns
    -------
    int
        Rows of the table.

    Raises
    ------
    InputError
        An input is missing or unreadable, or an option is unknown or missing.
    """
    entry = table_entry(name)
    if missing := [needed for needed in entry.inputs if needed not in inputs]:
        raise InputError(f"table {name}: needs the input {missing[0]!r}")
    given = [known for known in (*entry.inputs, *entry.optional) if known in inputs]
    table = _made(entry, {known: read_table(Path(inputs[known])) for known in given}, options)
    for column in table.select_dtypes("floating"):
        table[column] = [float(f"{value:.{_DIGITS}g}") for value in table[column]]
    write_table(table, *outputs)
    return len(table)


def _made(entry: TableEntry, inputs: Mapping[str, Any], options: Mapping[str, Any]) -> Any:
    try:
        signature(entry.make).bind(**inputs, **options)
    except TypeError as error:
        raise InputError(f"table {entry.name}: options: {error}") from error
    return entry.make(**inputs, **options)

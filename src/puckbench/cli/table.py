"""`puckbench table`: make a table of the sensor study (thesis chapter 5) or of the benchmark."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object
from puckbench.core.errors import InputError
from puckbench.thesis.tables import REGISTRY, RESULTS, VERDICTS, table_entry

_DIGITS = 6
"""Significant digits of a table's numbers: more than any measurement here has."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("table", help=f"one of {', '.join(REGISTRY | RESULTS | VERDICTS)}")
    parser.add_argument("out", type=Path, nargs="+", help="files to write (.csv, .parquet)")
    parser.add_argument(
        "--inputs", type=json_object, default={}, help='JSON: {"residuals": "residuals.parquet"}'
    )
    parser.add_argument(
        "--options", type=json_object, default={}, help='JSON: {"anchor": "draco"} for bd_rate'
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Read the inputs, make the table and write it."""
    from puckbench.io.tables import read_table, write_table

    entry = table_entry(options.table)
    if missing := [name for name in entry.inputs if name not in options.inputs]:
        raise InputError(f"table {options.table}: needs the input {missing[0]!r}")
    given = [*entry.inputs, *(name for name in entry.optional if name in options.inputs)]
    inputs = {name: read_table(Path(options.inputs[name])) for name in given}
    table = _made(options.table, entry.load(), inputs, options.options)
    for name in table.select_dtypes("floating"):
        table[name] = [float(f"{value:.{_DIGITS}g}") for value in table[name]]
    write_table(table, *options.out)
    return {
        "table": options.table,
        "rows": len(table),
        "files": [str(path) for path in options.out],
    }


def _made(
    name: str, function: Callable[..., Any], inputs: dict[str, Any], options: dict[str, Any]
) -> Any:
    """The table; InputError for options that it does not take or lacks."""
    try:
        signature(function).bind(**inputs, **options)
    except TypeError as error:
        raise InputError(f"table {name}: options: {error}") from error
    return function(**inputs, **options)

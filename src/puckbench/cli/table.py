"""`puckbench table`: make a table of the sensor study (thesis chapter 5)."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.analysis.registry import REGISTRY, table_entry
from puckbench.cli.types import json_object
from puckbench.errors import InputError

_DIGITS = 6
"""Significant digits of a table's numbers: more than any measurement here has."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("table", help=f"one of {', '.join(REGISTRY)}")
    parser.add_argument("out", type=Path, nargs="+", help="files to write (.csv, .parquet)")
    parser.add_argument(
        "--inputs", type=json_object, default={}, help='JSON: {"residuals": "residuals.parquet"}'
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Read the inputs, make the table and write it."""
    from puckbench.tablefiles import read_table, write_table

    entry = table_entry(options.table)
    if missing := [name for name in entry.inputs if name not in options.inputs]:
        raise InputError(f"table {options.table}: needs the input {missing[0]!r}")
    inputs = {name: read_table(Path(options.inputs[name])) for name in entry.inputs}
    table = entry.load()(**inputs)
    for name in table.select_dtypes("floating"):
        table[name] = [float(f"{value:.{_DIGITS}g}") for value in table[name]]
    write_table(table, *options.out)
    return {
        "table": options.table,
        "rows": len(table),
        "files": [str(path) for path in options.out],
    }

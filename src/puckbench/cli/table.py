from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import files_by_name, json_object, made_of_tables, selected
from puckbench.steps.table import Table
from puckbench.tables.registry import TABLES


def arguments(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(TABLES.names())
    add = parser.add_argument
    add("table", help=f"one of {names}, or path/to/file.py:function")
    add("out", type=Path, nargs="+", help="files to write (.csv, .parquet, .tex)")
    add("--inputs", type=json_object, default={}, help='JSON: {"residuals": "residuals.parquet"}')
    add("--options", type=json_object, default={}, help='JSON: {"anchor": "draco"} for bd_rate')


def run(options: argparse.Namespace) -> dict[str, Any]:
    step = Table.create(**selected(options, "table", "options"))
    inputs = files_by_name(options.inputs, "--inputs")
    with made_of_tables(f"table {options.table}"):
        return step.run(tuple(options.out), **inputs)

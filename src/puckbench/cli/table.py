"""`puckbench table`: make a table of the sensor study (thesis chapter 5) or of the benchmark."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import chosen, files_by_name, json_object
from puckbench.jobs.table import Table
from puckbench.metrics.table_registry import TABLES


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    known = ", ".join(TABLES.names())
    parser.add_argument("table", help=f"one of {known}, or path/to/file.py:function")
    parser.add_argument("out", type=Path, nargs="+", help="files to write (.csv, .parquet)")
    parser.add_argument(
        "--inputs", type=json_object, default={}, help='JSON: {"residuals": "residuals.parquet"}'
    )
    parser.add_argument(
        "--options", type=json_object, default={}, help='JSON: {"anchor": "draco"} for bd_rate'
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Read the inputs, make the table and write it."""
    job = Table.given(**chosen(options, "table", "options"))
    return job.run(tuple(options.out), **files_by_name(options.inputs, "--inputs"))

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import files_by_name, json_object, selected
from puckbench.jobs.table import Table
from puckbench.metrics.table_registry import TABLES


def arguments(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(TABLES.names())
    parser.add_argument("table", help=f"one of {names}, or path/to/file.py:function")
    parser.add_argument("out", type=Path, nargs="+", help="files to write (.csv, .parquet, .tex)")
    parser.add_argument(
        "--inputs", type=json_object, default={}, help='JSON: {"residuals": "residuals.parquet"}'
    )
    parser.add_argument(
        "--options", type=json_object, default={}, help='JSON: {"anchor": "draco"} for bd_rate'
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    job = Table.create(**selected(options, "table", "options"))
    return job.run(tuple(options.out), **files_by_name(options.inputs, "--inputs"))

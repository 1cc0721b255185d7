from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object
from puckbench.jobs.report import Report


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, help="page to write (.html)")
    parser.add_argument(
        "--contents",
        type=json_object,
        required=True,
        help='JSON: {"metrics": "metrics.csv", "tables": {"bd_rate": "bd_rate.csv"}, ...}',
    )
    parser.add_argument(
        "--code",
        nargs="+",
        metavar="PLACE",
        default=[],
        help="your figures and tables among the contents (path/to/file.py:function)",
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    return Report.create(contents=options.contents, code=tuple(options.code)).run(options.out)

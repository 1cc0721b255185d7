from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object, made_of_tables
from puckbench.steps.report_page import Report


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("out", type=Path, help="page to write (.html)")
    text = 'JSON: {"metrics": "metrics.csv", "tables": {"bd_rate": "bd_rate.csv"}, ...}'
    add("--contents", type=json_object, required=True, help=text)
    text = "your figures and tables among the contents (path/to/file.py:function)"
    add("--code", nargs="+", metavar="PLACE", default=[], help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    step = Report.create(contents=options.contents, code=tuple(options.code))
    with made_of_tables("report"):
        return step.run(options.out)

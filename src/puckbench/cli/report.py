"""`puckbench report`: one HTML file with figures, tables, curves and clouds of a run."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object
from puckbench.core.files import write_bytes


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("out", type=Path, help="page to write (.html)")
    parser.add_argument(
        "--contents",
        type=json_object,
        required=True,
        help='JSON: {"metrics": "metrics.csv", "tables": {"bd_rate": "bd_rate.csv"}, ...}',
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Build the page and write it."""
    from puckbench.report.build import build_page
    from puckbench.report.contents import Contents
    from puckbench.report.facts import this_machine

    text = build_page(Contents.from_json(options.contents), this_machine(), options.out.parent)
    data = text.encode()
    write_bytes(options.out, data)
    return {"page": str(options.out), "bytes": len(data)}

"""`puckbench data`: fetch the free data sets through npm and apt, with licences and credits."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.datasets.fetch import fetch_data


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "names",
        nargs="*",
        help="what to fetch: captured_rooms, sweethome3d (both by default), pcgc_weights, "
        "reno_weights",
    )
    parser.add_argument("--folder", type=Path, default=Path("data"), help="default: data")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Fetch; a set that cannot be had is named, after the others have been fetched."""
    found = fetch_data(options.folder, options.names)
    failed = [f"{item.name}: {item.message}" for item in found if item.status == "failed"]
    if failed:
        raise InputError("; ".join(failed))
    return {item.name: f"{item.status}: {item.folder} {item.message}".strip() for item in found}

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from puckbench.scene_sets.fetch import fetch_data
from puckbench.scene_sets.sources import SOURCES


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    default = ", ".join(name for name, source in SOURCES.items() if source.by_default)
    others = ", ".join(name for name, source in SOURCES.items() if not source.by_default)
    text = f"sets to download (default: {default}); also {others}"
    add("names", nargs="*", help=text)
    add("--folder", type=Path, default=Path("data"), help="folder of the data (default: data)")
    text = "take files of GitHub from this clone of their repository, or from a folder of clones"
    add("--from", type=Path, dest="clone", metavar="CLONE", help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    items = fetch_data(options.folder, options.names, options.clone)
    failed = [f"{item.name}: {item.message}" for item in items if item.status == "failed"]
    if failed:
        raise InputError("; ".join(failed))
    return {item.name: f"{item.status}: {item.folder} {item.message}".strip() for item in items}

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from puckbench.scene_sets.fetch import fetch_data


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    others = "pcgc_weights, reno_weights, ouster_recordings"
    text = f"sets to download (default: captured_rooms, sweethome3d); also {others}"
    add("names", nargs="*", help=text)
    add("--folder", type=Path, default=Path("data"), help="folder of the data (default: data)")


def run(options: argparse.Namespace) -> dict[str, Any]:
    items = fetch_data(options.folder, options.names)
    failed = [f"{item.name}: {item.message}" for item in items if item.status == "failed"]
    if failed:
        raise InputError("; ".join(failed))
    return {item.name: f"{item.status}: {item.folder} {item.message}".strip() for item in items}

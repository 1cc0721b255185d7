from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from puckbench.scene_sets.fetch import fetch_data


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    weights = "pcgc_weights, reno_weights, lizip_weights, polopcac_weights"
    recorded = "ouster_recordings, sfnd_lidar_1, sfnd_lidar_2, sfnd_tracking, inter_lpcm_turns"
    text = f"sets to download (default: captured_rooms, sweethome3d); also {weights}, {recorded}"
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

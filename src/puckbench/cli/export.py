"""`puckbench export`: a scan or a capture in the format of another tool, chosen by the suffix."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("table", type=Path, help="scan or capture table (.parquet)")
    parser.add_argument("out", type=Path, help=".ply, .pcd, .csv, .las, .laz, .evd or .pcap")
    parser.add_argument("--clean", action="store_true", help="take a scan's true coordinates")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the file."""
    from puckbench.lidar.export import export, read_source

    return export(options.out, read_source(options.table), options.clean)

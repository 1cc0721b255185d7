"""`puckbench export`: write a scan or a packet capture in another format."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("table", type=Path, help="scan or capture table (.parquet)")
    parser.add_argument("out", type=Path, help=".ply, .pcd, .csv, .las, .laz, .evd or .pcap")
    parser.add_argument(
        "--clean", action="store_true", help="use the coordinates without errors of a scan"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.lidar.export import export, read_source

    return export(options.out, read_source(options.table), options.clean)

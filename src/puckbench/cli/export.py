"""`puckbench export`: write turns of a recording, a scan or a capture table in another format."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.capture import STREAM
from puckbench.cli.types import turns
from puckbench.core.errors import InputError


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        type=Path,
        help="recording (.pcap, .puck, ROS bag), its turns (.parquet), or scan or capture table "
        "(.parquet)",
    )
    parser.add_argument(
        "out",
        type=Path,
        help=".ply, .pcd, .csv, .las, .laz or .bin (KITTI, intensity 0 to 1); of scans also .evd "
        "or .pcap",
    )
    parser.add_argument(
        "--turns",
        metavar="FIRST-LAST",
        help="turns of a recording, in metres in the sensor's frame, with intensity, ring (0 is "
        "the lowest) and time in s (default: the first whole turn)",
    )
    parser.add_argument("--stream", help=STREAM)
    parser.add_argument(
        "--clean", action="store_true", help="use the coordinates without errors of a scan"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.io.parquet_files import parquet_metadata
    from puckbench.jobs.prepare_returns import is_recording, read_selected_turns
    from puckbench.lidar.export import export, read_source
    from puckbench.lidar.returns import FiringTable

    source, out = options.source, options.out
    firings = FiringTable.schema.metadata_key.encode()
    if is_recording(source) or firings in parquet_metadata(source):
        returns, left_out = read_selected_turns(source, turns(options.turns), options.stream)
        about = {"turns": len(returns.turns), "sensor": returns.sensor, **left_out}
        return {**export(out, returns, options.clean), **about}
    for option in ("turns", "stream"):
        if getattr(options, option) is not None:
            raise InputError(f"{source}: --{option} is for recordings")
    return export(out, read_source(source), options.clean)

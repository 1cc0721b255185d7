"""`puckbench capture`: a capture of a real VLP-16 or Puck Hi-Res as a table of its returns."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "capture", type=Path, help=".pcap, .puck, ROS bag, or cloud with a laser column"
    )
    parser.add_argument("out", type=Path, help="capture table to write (.parquet)")
    parser.add_argument("--sensor", help="name or YAML file (default: what the packets say)")
    parser.add_argument("--start", type=float, default=0.0, help="s after the first packet")
    parser.add_argument("--end", type=float, default=math.inf, help="s after the first packet")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Decode and write the table."""
    from puckbench.lidar import load_sensor
    from puckbench.lidar.recordings import read_recording, write_returns

    sensor = load_sensor(options.sensor) if options.sensor else None
    table = read_recording(options.capture, sensor, options.start, options.end)
    write_returns(options.out, table)
    return {"points": len(table), "turns": int(table["turn"].max()) + 1, **table.about}

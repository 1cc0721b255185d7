from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

TOPIC = "which topic of a ROS bag"
STREAM = "which sensor of a packet capture: sender:port, or 'sender:port to receiver:port'"
_INTERVAL = (
    "{} time, in s after the recording's first packet, from which times in the table count, too"
)


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("capture", type=Path, help=".pcap, .puck, ROS bag, or cloud with a laser column")
    add("out", type=Path, help="capture table to write (.parquet)")
    add("--sensor", help="name, YAML file, or db.xml of an HDL-64E (default: from the packets)")
    add("--stream", help=STREAM)
    add("--topic", help=TOPIC)
    add_time_unit(parser)
    add("--start", type=float, default=0.0, help=_INTERVAL.format("first"))
    add("--end", type=float, default=math.inf, help=_INTERVAL.format("last"))


def add_time_unit(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--time-unit``, the unit of a cloud's times."""
    from pointkit.lidar.times import TIME_UNITS

    text = "unit of a cloud's times (default: from their values)"
    parser.add_argument("--time-unit", choices=TIME_UNITS, help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    from pointkit.column_tables import write_column_table
    from pointkit.lidar.sensors import load_sensor
    from puckbench.recordings.reading import read_recording
    from puckbench.scene_sets.recordings import decompressed

    sensor = load_sensor(options.sensor) if options.sensor else None
    interval, stream, unit = (options.start, options.end), options.stream, options.time_unit
    with decompressed(options.capture) as path:
        table = read_recording(
            path, sensor, *interval, stream, unit, options.capture, options.topic
        )
    write_column_table(options.out, table)
    about = {name: value for name, value in table.about.items() if name != "rings"}
    return {"points": len(table), "turns": int(table["turn"].max()) + 1, **about}

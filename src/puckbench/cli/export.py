from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from puckbench.cli.capture import STREAM, TOPIC, add_time_unit
from puckbench.cli.types import refuse, turns


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    text = "recording (.pcap, .puck, ROS bag), or table (.parquet) of turns, a scan or a capture"
    add("source", type=Path, help=text)
    text = ".ply, .pcd, .csv, .las, .laz, .bin (KITTI, intensity 0 to 1); of scans also .evd, .pcap"
    add("out", type=Path, help=text)
    text = (
        "turns of a recording (default: the first whole turn), in metres in the sensor's frame, "
        "with intensity, ring (0 is the lowest) and time in s; of a bag's clouds, messages from 0, "
        "in the frame and with the values of the messages"
    )
    add("--turns", metavar="FIRST-LAST", help=text)
    add("--stream", help=STREAM)
    add("--topic", help=TOPIC)
    add_time_unit(parser)
    add("--clean", action="store_true", help="use a scan's coordinates without errors")


def run(options: argparse.Namespace) -> dict[str, Any]:
    from pointkit.column_tables import is_table_of
    from pointkit.lidar.returns import FiringTable
    from puck.recordings.pcap import refuse_stream
    from puckbench.recordings.cloud_messages import has_clouds
    from puckbench.recordings.export import export, export_points, read_source
    from puckbench.recordings.message_returns import read_message_columns
    from puckbench.scene_sets.recordings import decompressed, holds_clouds
    from puckbench.scene_sets.selected_turns import is_recording, read_selected_turns

    source, out, selection = options.source, options.out, turns(options.turns)
    if is_recording(source) and (holds_clouds(source) or has_clouds(source, options.topic)):
        refuse_stream(options.stream)
        refuse(options, {"clean": False}, f"is for scans ({source})")
        first, last = selection or (0, 0)
        unit = options.time_unit
        with decompressed(source) as bag:
            columns = read_message_columns(bag, options.topic, (first, last), unit)
        return {**export_points(out, columns), "messages": last - first + 1}
    if options.time_unit:
        raise InputError(f"{source}: --time-unit is for clouds of ROS bags")
    if is_recording(source) or is_table_of(source, FiringTable):
        returns, left_out = read_selected_turns(source, selection, options.stream, options.topic)
        about = {"turns": len(returns.turns), "sensor": returns.sensor, **left_out}
        return {**export(out, returns, options.clean), **about}
    for option in ("turns", "stream", "topic"):
        if getattr(options, option) is not None:
            raise InputError(f"{source}: --{option} is for recordings")
    return export(out, read_source(source), options.clean)

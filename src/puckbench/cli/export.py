from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError
from puckbench.cli.capture import STREAM, TOPIC, add_time_unit
from puckbench.cli.types import refuse, turns

if TYPE_CHECKING:
    from pointkit.lidar.returns import Returns

_FORMATS = ("ply", "pcd", "csv", "las", "laz", "bin")


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    text = (
        "recording (.pcap, .puck, ROS bag), table (.parquet) of turns, a scan or a capture, or "
        "cloud (PLY, PCD, LAS, E57, ...)"
    )
    add("source", type=Path, help=text)
    text = (
        ".ply, .pcd, .csv, .las, .laz, .bin (KITTI, intensity 0 to 1); of scans also .evd, .pcap; "
        "with --format a new folder"
    )
    add("out", type=Path, help=text)
    text = (
        "write a folder with a file for each turn or message, in the sensor's frame, and times.txt "
        "(when each begins, in s); of scans also poses.txt"
    )
    add("--format", choices=_FORMATS, help=text)
    text = (
        "with --format: poses of the sensor (TUM, KITTI), of which poses.txt and poses.tum have "
        "those at the times of the frames"
    )
    add("--poses", type=Path, metavar="FILE", help=text)
    text = (
        "turns of a recording (default: the first whole turn, or with --format all whole turns), "
        "in metres in the sensor's frame, "
        "with intensity, ring (0 is the lowest) and time in s; of a bag's clouds, messages from 0, "
        "in the frame and with the values of the messages"
    )
    add("--turns", metavar="FIRST-LAST", help=text)
    add("--stream", help=STREAM)
    add("--topic", help=TOPIC)
    add_time_unit(parser)
    add("--clean", action="store_true", help="use a scan's coordinates without errors")


def run(options: argparse.Namespace) -> dict[str, Any]:
    from cloud_files.clouds import SUFFIXES
    from cloud_files.content import plain_suffix
    from pointkit.column_tables import is_table_of
    from pointkit.lidar.returns import FiringTable
    from puck.recordings.pcap import refuse_stream
    from puckbench.recordings.export import export, export_points, read_source
    from puckbench.recordings.message_returns import read_message_columns
    from puckbench.scene_sets.recordings import decompressed, is_bag_of_clouds
    from puckbench.scene_sets.selected_turns import is_recording, read_selected_turns

    source, out, selection = options.source, options.out, turns(options.turns)
    has_messages = is_recording(source) and is_bag_of_clouds(source, options.topic)
    if has_messages:
        refuse_stream(options.stream)
        refuse(options, {"clean": False}, f"is for scans ({source})")
    elif options.time_unit:
        raise InputError(f"{source}: --time-unit is for clouds of ROS bags")
    if options.format:
        return _frames(options, selection, has_messages)
    refuse(options, {"poses": None}, "only with --format, for a folder of frames")
    if not out.suffix:
        raise InputError(f"{out}: give it a suffix, or name the format of a folder's files")
    if has_messages:
        first, last = selection or (0, 0)
        unit = options.time_unit
        with decompressed(source) as bag:
            columns = read_message_columns(bag, options.topic, (first, last), unit, source)
        return {**export_points(out, columns), "messages": last - first + 1}
    if is_recording(source) or is_table_of(source, FiringTable):
        returns, left_out = read_selected_turns(source, selection, options.stream, options.topic)
        about = {"turns": len(returns.turns), "sensor": returns.sensor, **left_out}
        return {**export(out, returns, options.clean), **about}
    _refuse_selection(options, "turns", "stream", "topic")
    if plain_suffix(source) not in SUFFIXES:
        return export(out, read_source(source), options.clean)
    from puckbench.recordings.cloud_export import export_file

    refuse(options, {"clean": False}, f"is for scans ({source})")
    return export_file(out, source)


def _refuse_selection(options: argparse.Namespace, *names: str) -> None:
    for name in names:
        if getattr(options, name) is not None:
            raise InputError(f"{options.source}: --{name} is for recordings")


def _frames(
    options: argparse.Namespace, selection: tuple[int, int] | None, has_messages: bool
) -> dict[str, Any]:
    """Write a folder of frames; return what the command answers."""
    from cloud_files.poses import read_lidar_poses
    from pointkit.column_tables import is_table_of
    from pointkit.lidar.return_table import ReturnTable, read_return_table
    from pointkit.lidar.returns import FiringTable
    from puckbench.recordings import frames
    from puckbench.recordings.cloud_messages import cloud_topic
    from puckbench.recordings.message_returns import iterate_messages
    from puckbench.recordings.table_turns import tell_cut_turns, whole_turns
    from puckbench.scene_sets.recordings import decompressed
    from puckbench.scene_sets.selected_turns import is_recording
    from virtual_lidar.scan_table import read_scan

    source, out, about = options.source, options.out, dict[str, Any]()
    pose_file = frames.PoseFile(options.poses) if options.poses else None
    if pose_file:
        read_lidar_poses(pose_file.path)  # for an error before frames are written
    if has_messages:
        with decompressed(source) as bag:
            found = iterate_messages(bag, options.topic, selection, options.time_unit, source)
            first, last = selection or (0, cloud_topic(bag, options.topic)[1].messages - 1)
            messages = (frames.Frame(*each) for each in found)
            count = last - first + 1
            return frames.write_frames(out, options.format, messages, count, pose_file)
    made: Iterable[frames.Frame]
    if is_recording(source) or is_table_of(source, FiringTable):
        refuse(options, {"clean": False}, f"is for scans ({source})")
        returns, numbers, about, begun_s = _turns(options, selection)
        made, count = frames.frames_of_returns(returns, numbers), len(numbers)
        pose_file = pose_file and pose_file._replace(origin_s=begun_s)
    elif is_table_of(source, ReturnTable):
        refuse(options, {"clean": False}, f"is for scans ({source})")
        _refuse_selection(options, "turns", "stream", "topic")
        table = read_return_table(source)
        tell_cut_turns(source, table)
        made, count = frames.frames_of_table(table), len(whole_turns(table))
    elif source.suffix.lower() == ".parquet":
        _refuse_selection(options, "turns", "stream", "topic")
        refuse(options, {"poses": None}, f"a scan has its own ({source})")
        scan = read_scan(source)
        made, count = frames.frames_of_scan(scan, options.clean), int(scan["frame"].max() + 1)
    else:
        raise InputError(f"{source}: no recording or table of turns, of which there are frames")
    return {**frames.write_frames(out, options.format, made, count, pose_file), **about}


def _turns(
    options: argparse.Namespace, selection: tuple[int, int] | None
) -> tuple[Returns, range, dict[str, Any], float]:
    """Read all turns of the source, the numbers of those to write, facts, and when it begins."""
    from pointkit.errors import naming
    from pointkit.lidar.returns import read_firings
    from puckbench.recordings.reading import read_turns
    from puckbench.scene_sets.recordings import decompressed
    from puckbench.scene_sets.selected_turns import check_selection, is_recording, select_turns

    source, left_out, begun_s = options.source, dict[str, int](), None
    with naming(source):
        check_selection(source, options.stream, options.topic)
        if is_recording(source):
            with decompressed(source) as path:
                recorded = read_turns(path, 0.0, options.stream, source, options.topic)
            returns, numbers, left_out, begun_s = recorded
        else:
            returns = read_firings(source)
            numbers = range(len(returns.turns))
        if selection:
            select_turns(returns, selection)  # checks the numbers
            numbers = range(selection[0], selection[1] + 1)
        if not numbers:
            raise InputError("has no whole turn (--turns takes others)")
    about = {"first_turn": numbers[0], "sensor": returns.sensor, **left_out}
    return returns, numbers, about, begun_s or 0.0

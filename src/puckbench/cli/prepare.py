from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cloud_files.content import plain_suffix
from pointkit.column_tables import is_table_of
from pointkit.errors import InputError
from pointkit.lidar.returns import returns_file
from puck.recordings.data_packets import LEFT_OUT
from puck.recordings.pcap import refuse_stream
from puckbench.cli.capture import STREAM, TOPIC
from puckbench.cli.types import add_cloud_options, add_unit, integer, refuse, selected, turns
from puckbench.geometry.scaling import GRID
from puckbench.jobs.prepare import Box, Prepare
from puckbench.jobs.prepare_message import PrepareMessage
from puckbench.jobs.prepare_recording import PrepareRecording, is_recording

_FOR_CLOUDS = {
    "metres_per_unit": 1,
    "drop_invalid": False,
    "keep_missing": False,
    "bin_columns": None,
}
"""Options that apply only to clouds, not to scans and recordings, with their defaults."""
_SHOWN = (
    *("name", "sensor", "turns", "points", "dropped_points", "missing_returns"),
    *("size", "size_m", "scale", "offset", "peak", *LEFT_OUT, "neighbours", "diameter"),
    *("elongation", "elongation_oriented", "spacing_median_m", "density_median_m2"),
    *("outliers", "duplicates"),
)


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    text = (
        "cloud (PLY, PCD, LAS, LAZ, E57, text, NumPy, KITTI's .bin), scan table (.parquet), or "
        "recording (.pcap, .puck, ROS bag)"
    )
    add("cloud", type=Path, help=text)
    add("out", type=Path, help="PLY file to write; its description (JSON) is written beside it")
    text = "x0 y0 z0 x1 y1 z1 in metres, or a JSON file with a 'box'"
    add("--crop", nargs="+", metavar="BOX", help=text)
    text = "size of the cube (default: 1024); 0: stay in metres; grid: keep the voxels"
    add("--scale", type=_size, help=text)
    add("--peak", type=float, help="peak of the PSNRs of a cloud in metres, in m (default: 30)")
    add("--neighbours", type=integer(3), default=30, help="neighbours for normals (default: 30)")
    add_unit(parser, "cloud")
    add_cloud_options(parser)
    add("--clean", action="store_true", help="use a scan's coordinates without errors")
    text = (
        "use these turns of a scan or a recording, in metres in the sensor's frame, and write "
        "their returns beside the cloud (default for a recording: its first whole turn); of clouds "
        "in a ROS bag, the one with this number, in metres (default: 0)"
    )
    add("--turns", metavar="FIRST-LAST", help=text)
    add("--stream", help=STREAM)
    add("--topic", help=TOPIC)
    add("--truth", type=Path, help="also write a scan's true surface points to this file")
    text = "JSON file whose 'name' and 'group' are copied to the description"
    add("--about", type=Path, action="append", default=[], help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    description = _prepared(options)
    return description if options.json else {k: description[k] for k in _SHOWN if k in description}


def _prepared(options: argparse.Namespace) -> dict[str, Any]:
    if is_recording(options.cloud) and _has_clouds(options):
        return _cloud_of_bag(options)
    is_of_sensor = options.turns or options.stream or options.topic or is_recording(options.cloud)
    is_scan = options.cloud.suffix == ".parquet"
    if is_of_sensor or is_scan:
        _check_options_of_clouds(options)
    if not is_scan:
        refuse(options, {"clean": False}, f"is for scans ({options.cloud})")
    if is_of_sensor:
        return _returns(options)
    _refuse_returns(options.cloud)
    _check_bin_columns(options)
    size = {} if options.scale is None else {"size": options.scale}
    return _cloud(options, clean=options.clean, **size)


def _check_bin_columns(options: argparse.Namespace) -> None:
    if plain_suffix(options.cloud) != ".bin":
        refuse(options, {"bin_columns": None}, f"is for .bin files ({options.cloud})")


def _check_in_metres(options: argparse.Namespace, what: str) -> None:
    if options.scale:
        raise InputError(f"--scale: not with {what}, which stay in metres ({options.cloud})")


def _cloud(
    options: argparse.Namespace, kind: type[Prepare] = Prepare, **settings: Any
) -> dict[str, Any]:
    words = options.crop or []
    file = Path(words[0]) if len(words) == 1 else None
    job = kind.create(
        box=_box(words) if words and file is None else None,
        neighbours=options.neighbours,
        drop_invalid=options.drop_invalid,
        keep_missing=options.keep_missing,
        **selected(options, "peak", "bin_columns", "metres_per_unit"),
        **settings,
    )
    return job.run(options.cloud, options.out, options.truth, file, tuple(options.about))


def _refuse_returns(path: Path) -> None:
    from pointkit.lidar.return_table import ReturnTable

    if is_table_of(path, ReturnTable):
        how = f"export it as a cloud first (puckbench export {path} cloud.ply)"
        raise InputError(f"{path}: a recording's table, not a scan's: {how}")


def _has_clouds(options: argparse.Namespace) -> bool:
    from puckbench.recordings.cloud_messages import has_clouds

    return has_clouds(options.cloud, options.topic)


def _cloud_of_bag(options: argparse.Namespace) -> dict[str, Any]:
    refuse_stream(options.stream)
    first, last = turns(options.turns) or (0, 0)
    if first != last:
        raise InputError(f"--turns: one cloud of a ROS bag is written, not {options.turns}")
    _check_in_metres(options, "clouds of a ROS bag")
    why = f"not with clouds of a ROS bag ({options.cloud})"
    refuse(options, {"clean": False, "bin_columns": None}, why)
    return _cloud(options, PrepareMessage, size=0, message=first, topic=options.topic)


def _check_options_of_clouds(options: argparse.Namespace) -> None:
    for name, default in _FOR_CLOUDS.items():
        if getattr(options, name) != default:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{options.cloud}: {option} is for clouds, not for scans, recordings")


def _returns(options: argparse.Namespace) -> dict[str, Any]:
    _check_in_metres(options, "turns")
    refuse(options, {"crop": None}, f"not with turns, which are whole ({options.cloud})")
    job = PrepareRecording.create(
        neighbours=options.neighbours,
        clean=options.clean,
        turns=turns(options.turns),
        **selected(options, "peak", "stream", "topic"),
    )
    out = options.out
    return job.run(options.cloud, out, returns_file(out), options.truth, tuple(options.about))


def _size(text: str) -> int | str:
    return GRID if text == GRID else int(integer(0)(text))


def _box(words: list[str]) -> Box:
    try:
        x0, y0, z0, x1, y1, z1 = map(float, words)
    except ValueError as error:
        raise InputError(
            f"--crop: must be six numbers or one JSON file, not {' '.join(words)}"
        ) from error
    return x0, y0, z0, x1, y1, z1

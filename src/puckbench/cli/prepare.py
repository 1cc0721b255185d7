from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cloud_files.clouds import checked_cloud
from cloud_files.content import plain_suffix
from pointkit.column_tables import is_table_of
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats, UncheckedCloud
from pointkit.lidar.returns import returns_file
from puck.recordings.data_packets import LEFT_OUT
from puck.recordings.pcap import refuse_stream
from puckbench.cli.capture import STREAM, TOPIC
from puckbench.cli.types import integer, refuse, turns
from puckbench.cli.units import (
    add_cloud_options,
    add_unit,
    cloud_of,
    in_unit_of,
    refuse_cloud_options,
)
from puckbench.geometry.scaling import GRID, METRIC
from puckbench.scene_sets.recordings import decompressed, is_bag_of_clouds
from puckbench.scene_sets.selected_turns import check_selection, is_recording, read_selected_turns
from puckbench.steps.prepare import Prepare, box_of, in_metres, names_and_groups, points_of_scan
from puckbench.steps.prepare_returns import (
    MeasuredReturns,
    PrepareReturns,
    read_measured_returns,
)
from virtual_lidar.scan_table import ScanTable

if TYPE_CHECKING:
    from puckbench.steps.preparation import MeasuredPoints

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
    if is_recording(options.cloud) and is_bag_of_clouds(options.cloud, options.topic):
        return _cloud_of_bag(options)
    is_of_sensor = options.turns or options.stream or options.topic or is_recording(options.cloud)
    is_scan = options.cloud.suffix == ".parquet"
    if is_of_sensor or is_scan:
        refuse_cloud_options(options, f"is for clouds, not for scans, recordings ({options.cloud})")
    if not is_scan:
        refuse(options, {"clean": False}, f"is for scans ({options.cloud})")
    if is_of_sensor:
        return _returns(options)
    _refuse_returns(options.cloud)
    _check_bin_columns(options)
    scale = METRIC if options.scale == 0 else options.scale
    size = {} if scale is None else {"size": scale}
    if is_scan:
        return _cloud(options, points_of_scan(options.cloud, options.clean), **size)
    return _cloud(options, _measured(options, cloud_of(options, options.cloud)), **size)


def _check_bin_columns(options: argparse.Namespace) -> None:
    if plain_suffix(options.cloud) != ".bin":
        refuse(options, {"bin_columns": None}, f"is for .bin files ({options.cloud})")


def _check_in_metres(options: argparse.Namespace, what: str) -> None:
    if options.scale:
        raise InputError(f"--scale: not with {what}, which stay in metres ({options.cloud})")


def _cloud(options: argparse.Namespace, points: MeasuredPoints, **settings: Any) -> dict[str, Any]:
    words = options.crop or []
    step = Prepare.create(neighbours=options.neighbours, **settings)
    if options.peak is not None and not step.is_metric:
        raise InputError("peak: only for clouds in metres; that of a scaled cloud is its size - 1")
    box = None
    if words:
        box = box_of(Path(words[0])) if len(words) == 1 else _box(words)
    names = names_and_groups(options.out, *options.about)
    files = options.out, options.truth
    return step.write(options.cloud, points, names, *files, box, _peak(options))


def _peak(options: argparse.Namespace) -> dict[str, float]:
    if options.peak is None:
        return {}
    if not 0 < options.peak < math.inf:
        raise InputError(f"--peak: must be above 0, not {options.peak:g}")
    return {"peak": options.peak}


def _measured(options: argparse.Namespace, cloud: UncheckedCloud) -> MeasuredPoints:
    from puckbench.steps.preparation import MeasuredPoints

    converted = in_unit_of(options, in_metres(checked_cloud(cloud, options.cloud)))
    return MeasuredPoints(converted, clean=converted)


def _refuse_returns(path: Path) -> None:
    from pointkit.lidar.return_table import ReturnTable

    if is_table_of(path, ReturnTable):
        how = f"export it as a cloud first (puckbench export {path} cloud.ply)"
        raise InputError(f"{path}: a recording's table, not a scan's: {how}")


def _cloud_of_bag(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.recordings.cloud_messages import read_recorded_cloud

    refuse_stream(options.stream)
    first, last = turns(options.turns) or (0, 0)
    if first != last:
        raise InputError(f"--turns: one cloud of a ROS bag is written, not {options.turns}")
    _check_in_metres(options, "clouds of a ROS bag")
    why = f"not with clouds of a ROS bag ({options.cloud})"
    refuse(options, {"clean": False, "bin_columns": None}, why)
    kept = options.keep_missing, options.drop_invalid
    with decompressed(options.cloud) as bag:
        cloud = read_recorded_cloud(bag, first, options.topic, *kept, options.cloud)
    about = {"source": options.cloud.name, "message": first, **cloud.about}
    return _cloud(options, _measured(options, replace(cloud, about=about)), size=METRIC)


def _returns(options: argparse.Namespace) -> dict[str, Any]:
    _check_in_metres(options, "turns")
    refuse(options, {"crop": None}, f"not with turns, which are whole ({options.cloud})")
    out, step = options.out, PrepareReturns.create(neighbours=options.neighbours)
    measured, names = _measured_returns(options), names_and_groups(options.out, *options.about)
    files = (out, returns_file(out), options.truth)
    return step.write(options.cloud, measured, names, *files, _peak(options))


def _measured_returns(options: argparse.Namespace) -> MeasuredReturns:
    path, selection = options.cloud, turns(options.turns)
    if is_table_of(path, ScanTable):
        with naming(path):
            check_selection(path, options.stream, options.topic)
        return read_measured_returns(path, selection, options.clean)
    returns, left_out = read_selected_turns(path, selection, options.stream, options.topic)
    about = {"source": path.name, "sensor": returns.sensor, **left_out}
    return MeasuredReturns(returns, None, about)


def _size(text: str) -> int | str:
    return GRID if text == GRID else int(integer(0)(text))


def _box(words: list[str]) -> Floats:
    try:
        x0, y0, z0, x1, y1, z1 = map(float, words)
    except ValueError as error:
        raise InputError(
            f"--crop: must be six numbers or one JSON file, not {' '.join(words)}"
        ) from error
    corners = np.array([[x0, y0, z0], [x1, y1, z1]])
    if not np.isfinite(corners).all():
        raise InputError(f"--crop: must be six numbers or one JSON file, not {' '.join(words)}")
    return np.sort(corners, axis=0)

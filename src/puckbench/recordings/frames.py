"""Folders of frames: a file for each turn (revolution) or message of a recording.

The file ``times.txt`` has the time of each frame in s. If poses are known, ``poses.txt`` (KITTI's
format) and ``poses.tum`` have the pose of the sensor at that time.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cloud_files.clouds import read_cloud
from cloud_files.poses import kitti_bytes, tum_bytes
from pointkit.errors import InputError, counted
from pointkit.files import folder_written_whole
from pointkit.geometry.cloud import Floats
from pointkit.lidar.return_table import UNKNOWN, ReturnTable
from pointkit.lidar.returns import HOUR_US, Returns
from pointkit.lidar.turns import clock_steps, elapsed
from pointkit.terminal import Progress
from puckbench.recordings.drive_poses import poses_at
from puckbench.recordings.export import (
    Columns,
    column_us,
    columns_of_returns,
    export_points,
)
from puckbench.recordings.pose_axes import axes_from_turns
from puckbench.recordings.table_turns import (
    ranks,
    ranks_of_lasers,
    rings_of_table,
    turn_of_table,
    whole_turns,
)
from virtual_lidar.scan_returns import frame_poses, sensor_points
from virtual_lidar.scan_table import ScanTable

_log = logging.getLogger(__name__)


class PoseFile(NamedTuple):
    """A file of poses of the sensor, in TUM's or KITTI's format.

    Parameters
    ----------
    path
        The file, as for `drive_poses.poses_at`.
    origin_s
        Time of the poses, s, from which the times of frames count.
    """

    path: Path
    origin_s: float = 0.0


class Frame(NamedTuple):
    """A turn or message of a recording.

    Parameters
    ----------
    seconds
        Time at which the frame begins, s: that of the first packet of a turn, of the first return
        of a turn in a table, or of the first point of a message.
    columns
        Values of the points, (n,), by name: ``x``, ``y`` and ``z`` in m, in the sensor's frame, and
        what is known of ``intensity``, ``ring`` (0 is the lowest laser) and ``time`` (s after the
        frame's).
    pose
        Matrix (4, 4) that transforms the sensor's coordinates at the frame's time to fixed ones, in
        m; None if it is not known.
    """

    seconds: float
    columns: Columns
    pose: Floats | None = None


def write_frames(
    folder: Path,
    form: str,
    frames: Iterable[Frame],
    count: int,
    pose_file: PoseFile | None = None,
) -> dict[str, Any]:
    """Write frames to a folder, one file for each: ``000000.pcd`` and so on.

    The folder appears only when it is complete. Frames without a point are left out, with a
    warning.

    Parameters
    ----------
    folder
        The folder, which must be empty or not exist.
    form
        Format of the files: a suffix in `export.OF_POINTS`, without its dot.
    frames
        The frames, of which one at a time is held in memory.
    count
        Number of frames, of which those without a point may be missing.
    pose_file
        File of poses, for frames without poses. Its poses are interpolated at the times of the
        frames; they get the frames' axes if the frames show that they have other ones
        (`pose_axes.in_axes_of_turns`).

    Returns
    -------
    dict
        Numbers of ``frames`` and of ``points``.

    Raises
    ------
    InputError
        The folder is not empty, no frame has a point, a frame cannot be written, or the poses of
        the file do not cover the frames.
    """
    progress, told = Progress("frame"), list[str]()
    seconds, poses, points = list[float](), list[Floats](), 0

    def tell_once(path: Path, text: str) -> None:
        if not told:
            _log.warning("%s: in %s and perhaps others, %s", folder, path.name, text)
            told.append(text)

    with folder_written_whole(folder) as place:
        for number, frame in enumerate(frames, 1):
            progress(number, count)
            if not len(frame.columns["x"]):
                continue
            path = _file(place, len(seconds), form)
            points += export_points(path, frame.columns, tell_once)["points"]
            seconds.append(frame.seconds)
            if frame.pose is not None:
                poses.append(frame.pose)
        if not seconds:
            raise InputError(f"{folder}: no frame has a point")
        (place / "times.txt").write_text("".join(f"{time:.6f}\n" for time in seconds))
        if pose_file:
            poses = [*_poses_of_file(pose_file, np.array(seconds), place, form)]
        if poses:
            (place / "poses.txt").write_bytes(kitti_bytes(np.array(poses)))
            (place / "poses.tum").write_bytes(tum_bytes(np.array(seconds), np.array(poses)))
    if empty := count - len(seconds):
        _log.warning("%s: left out %s without a point", folder, counted(empty, "frame"))
    return {"frames": len(seconds), "points": points}


def _file(folder: Path, number: int, form: str) -> Path:
    return folder / f"{number:06d}.{form}"


def _poses_of_file(pose_file: PoseFile, seconds: Floats, folder: Path, form: str) -> Floats:
    """Return the poses of a file at the times of the frames in a folder, in their axes."""
    poses = poses_at(pose_file.path, pose_file.origin_s + seconds)
    columns = "4" if form == "bin" else None

    def points_of(number: int) -> Floats:
        return read_cloud(_file(folder, number, form), bin_columns=columns).xyz

    matrix, _ = axes_from_turns(str(pose_file.path), poses, points_of)
    return np.asarray(poses @ matrix)


def frames_of_returns(returns: Returns, numbers: range) -> Iterator[Frame]:
    """Yield turns of a recording of packets, or of a table of firings.

    Parameters
    ----------
    returns
        All turns of the recording.
    numbers
        Numbers of the turns to yield. Times count from the first packet of turn 0; they are 0 if
        packets have no times.
    """
    sequence_us, begins = column_us(returns), _begins_us(returns)
    for number, turn in enumerate(returns.split()):
        if number in numbers:
            columns = columns_of_returns(turn, sequence_us)
            if "time" in columns and len(columns["time"]):
                columns["time"] = columns["time"] + _first_return_us(turn) * 1e-6
            yield Frame(begins[number] * 1e-6, columns)


def _begins_us(returns: Returns) -> Floats:
    clock = [0 if turn.times is None else int(turn.times[0]) for turn in returns.turns]
    return elapsed(np.array(clock, np.float64), HOUR_US)


def _first_return_us(returns: Returns) -> float:
    """Return the time of the packet of a turn's first return after the turn's first packet."""
    (turn,), layout = returns.turns, returns.layout
    if turn.times is None:
        return 0.0
    packet = returns.indices(turn)[0][0] // (layout.columns_per_block * layout.blocks_per_time)
    clock = turn.times[[0, packet]].astype(np.float64)
    return float(clock_steps(clock, HOUR_US)[0])


def frames_of_table(table: ReturnTable, numbers: Iterable[int] | None = None) -> Iterator[Frame]:
    """Yield turns of a table of returns.

    Parameters
    ----------
    table
        The table.
    numbers
        Numbers of turns; by default, those that are not cut off (`whole_turns`).
    """
    rings = rings_of_table(table)
    for number in whole_turns(table) if numbers is None else numbers:
        is_turn = table["turn"] == number
        turn = turn_of_table(table, number)
        begin = float(turn["timestamp"].min(initial=np.inf)) if len(turn) else 0.0
        columns = {
            **{axis: turn[axis] for axis in "xyz"},
            "ring": rings[is_turn],
            "time": turn["timestamp"] - begin,
        }
        if (table["reflectivity"] != UNKNOWN).all():
            columns["intensity"] = turn["reflectivity"].astype(np.float32)
        yield Frame(begin, columns)


def frames_of_scan(table: ScanTable, clean: bool = False) -> Iterator[Frame]:
    """Yield the frames of a virtual scan, with the poses of its sensor.

    Parameters
    ----------
    table
        The scan.
    clean
        Whether to take true distances instead of the measured ones.
    """
    points = sensor_points(table, "distance" if clean else "distance_noisy")
    rings, poses = _rings_of_scan(table), frame_poses(table)
    hertz = table.about.get("sweep", {}).get("frames_per_second")
    for number in np.unique(table["frame"]).tolist():
        rows = np.flatnonzero(table["frame"] == number)
        times = table["timestamp"][rows]
        begin = number / hertz if hertz else float(times.min())
        columns = {
            **dict(zip("xyz", points[rows].T, strict=True)),
            "ring": rings[rows],
            "time": times - begin,
        }
        if "reflectivity" in table.columns:
            columns["intensity"] = table["reflectivity"][rows].astype(np.float32)
        yield Frame(begin, columns, None if poses is None else poses[number])


def _rings_of_scan(table: ScanTable) -> NDArray[np.uint16]:
    elevations = table.about.get("sensor", {}).get("laser_elevation_deg", ())
    if not len(elevations) > table["laser_id"].max(initial=0):
        return ranks(table["pitch"])
    return np.asarray(ranks_of_lasers(elevations)[table["laser_id"]])

"""Poses of a drive from a file whose poses may have another rate than the turns of the sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cloud_files.poses import read_lidar_poses
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

_REACH = 1.1
"""Time before the first and after the last pose for which the motion is assumed to go on, as a
multiple of the time between two poses."""
_LONGEST_GAP_S = 1.0
"""Longest time between two poses within which the motion is interpolated."""


def poses_of_file(
    path: str | Path, starts: Floats, turn_s: float, *, are_known: bool = True
) -> tuple[Floats, Floats]:
    """Read the poses of a drive from a file in TUM's or KITTI's format.

    If the file has times and these cover the turns, the poses hold at their times, whatever their
    rate. Otherwise there must be as many poses as turns, which hold at the middle of each.

    Parameters
    ----------
    path
        File of poses, as for `read_lidar_poses`.
    starts
        Times at which the turns begin, (number of turns,), in s.
    turn_s
        Duration of a turn, in s.
    are_known
        Whether the times of the turns are known, so that times of poses tell what belongs together.

    Returns
    -------
    times
        Times of the poses, (n,), in s.
    poses
        Poses, (n, 4, 4), as matrices that transform sensor coordinates to fixed coordinates, in m.

    Raises
    ------
    InputError
        The file has no such poses, or leaves out more than a second of the drive.
    """
    times, poses = read_lidar_poses(path)
    fault = f"{len(poses)} poses for {len(starts)} turns"
    begin, end = float(starts[0]), float(starts[-1]) + turn_s
    if times is not None and len(times) > 1 and are_known:
        reach = _REACH * np.diff(times)
        if times[0] - reach[0] <= begin and end <= times[-1] + reach[-1]:
            first = int(np.searchsorted(times, begin, "right")) - 1
            first = min(max(first, 0), len(times) - 2)
            used = slice(first, max(int(np.searchsorted(times, end)) + 1, first + 2))
            _check_gaps(path, times[used])
            return times[used], poses[used]
        fault += f", poses from {times[0]:.3f} to {times[-1]:.3f} s"
        fault += f", turns from {begin:.3f} to {end:.3f} s"
    if len(poses) != len(starts):
        needed = "one for each turn, or times that cover the turns, are needed"
        needed = needed if are_known else "one for each is needed, as times of turns are unknown"
        raise InputError(f"{path}: {fault}: {needed}")
    return starts + turn_s / 2, poses


def _check_gaps(path: str | Path, times: Floats) -> None:
    steps = np.diff(times)
    if (gaps := np.flatnonzero(steps > _LONGEST_GAP_S)).size:
        first = gaps[0]
        gap = f"for {steps[first]:.3g} s after {times[first]:.3f} s"
        raise InputError(f"{path}: no pose {gap}, during the drive")


def extended(times: Floats, poses: Floats) -> tuple[Floats, Floats]:
    """Return poses with one more at each end, as if the motion there went on as it was.

    Parameters
    ----------
    times
        Times of two or more poses, (n,), in s.
    poses
        Poses, (n, 4, 4).

    Returns
    -------
    times
        Times of the poses, (n + 2,), in s.
    poses
        Poses, (n + 2, 4, 4).
    """
    before, after = _beyond(poses[1], poses[0]), _beyond(poses[-2], poses[-1])
    begin = times[0] - _REACH * (times[1] - times[0])
    end = times[-1] + _REACH * (times[-1] - times[-2])
    return np.concatenate([[begin], times, [end]]), np.concatenate([[before], poses, [after]])


def _beyond(near: Floats, last: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    motion = np.linalg.inv(near) @ last
    turned = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    motion[:3, :3] = Rotation.from_rotvec(_REACH * turned).as_matrix()
    motion[:3, 3] *= _REACH
    return np.asarray(last @ motion)


def interpolated(times: Floats, poses: Floats, at: Floats) -> Floats:
    """Interpolate poses in time.

    Parameters
    ----------
    times
        Times of the poses, (n,), in s.
    poses
        Poses, (n, 4, 4).
    at
        Times of the results, (m,), in s. Before the first pose and after the last, the result is
        that pose.

    Returns
    -------
    numpy.ndarray
        Poses, (m, 4, 4).
    """
    from scipy.spatial.transform import Rotation, Slerp

    if len(times) == 1:
        return np.repeat(poses, len(at), axis=0)
    within = np.clip(at, times[0], times[-1])
    result = np.tile(np.eye(4), (len(at), 1, 1))
    turned = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))
    result[:, :3, :3] = turned(within).as_matrix()
    for axis in range(3):
        result[:, axis, 3] = np.interp(within, times, poses[:, axis, 3])
    return result


def poses_at(path: str | Path, times: Floats) -> Floats:
    """Read the poses of a file at given times.

    Parameters
    ----------
    path
        File of poses, as for `read_lidar_poses`. If its times do not cover the given ones, or if it
        has none, there must be one pose for each time.
    times
        Times, (n,), in s.

    Returns
    -------
    numpy.ndarray
        Poses, (n, 4, 4), as in `poses_of_file`.

    Raises
    ------
    InputError
        As for `poses_of_file`.
    """
    pose_times, poses = poses_of_file(path, times, 0.0)
    if len(pose_times) > 1:
        pose_times, poses = extended(pose_times, poses)
    return interpolated(pose_times, poses, times)

"""Drives: consecutive turns of a moving sensor, together with its poses, in one archive.

A turn is one revolution of the sensor. The archive contains the poses as ``poses.tum``, the times
and the description as ``drive.json``, and each turn as ``0000.parquet`` (returns) or ``0000.ply``
(points).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import NonNegativeFloat

from cloud_files.clouds import cloud_bytes, read_cloud
from cloud_files.poses import poses_of, tum_bytes
from pointkit.errors import InputError, naming
from pointkit.files import json_bytes, object_of
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.lidar.returns import Returns, read_firings, write_firings
from pointkit.models import Model, parsed
from puckbench.core.archives import read_archive, write_archive
from puckbench.recordings.drive_poses import interpolated

KEPT, AZIMUTH, NONE = "kept", "azimuth", "none"
"""Values of the column ``times``, which says where the times of a decoded turn's points come from:
the codec kept them, they were computed from the azimuths of the points, or there are none.
"""
UNDECODED_POSES = "KISS-ICP on the undecoded turns"
"""Value of the column ``poses`` for drives without true poses. KISS-ICP then estimated the
reference poses from the turns before coding.
"""
TURN_SHARE = "turn_share"
"""Field with the times of a turn's points, as fractions of the turn's duration from 0 to 1."""
_POSES, _ABOUT = "poses.tum", "drive.json"
_GAP = 1.5
"""Largest time between two turns, as a multiple of the median time."""
_CLOCK_S = 1e-6
_EARLIER = 1e-4
"""Angle, in radians, by which a fitted azimuth is smaller: rounded points of a turn's first azimuth
would be at its end otherwise."""
_LEAST_FIT = 0.9
"""Least length of the mean of unit vectors at the azimuths' deviations, if times are azimuths."""


class _Description(Model):
    starts: tuple[float, ...]
    turn_s: NonNegativeFloat
    about: Mapping[str, Any]


@dataclass(frozen=True)
class Drive:
    """Consecutive turns of a moving sensor, with its poses; the input of odometry.

    A turn is one revolution of the sensor.

    Parameters
    ----------
    turns
        Points of each turn, in m, in the sensor's coordinates; with the turn's ``returns`` if they
        are known.
    starts
        Times at which the turns begin, (number of turns,), in s.
    turn_s
        Duration of a turn, in s; 0 if all its points have one time.
    pose_times
        Times of the m poses, (m,), in s.
    poses
        Poses, (m, 4, 4), as matrices that transform sensor coordinates to world coordinates, in m.
    about
        Description: scene, seed, sensor, error model, and source of the poses.

    Raises
    ------
    InputError
        There are fewer than two turns, times decrease, turns are missing, or poses do not cover the
        turns.
    """

    turns: tuple[PointCloud, ...]
    starts: Floats
    turn_s: float
    pose_times: Floats
    poses: Floats
    about: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.turns) < 2 or len(self.starts) != len(self.turns):
            count, times = len(self.turns), len(self.starts)
            raise InputError(
                f"{count} turns and {times} times: a drive has a time for each of two or more turns"
            )
        check_times(self.starts)
        end = self.starts[-1] + self.turn_s
        middle = self.starts[0] + self.turn_s / 2
        if self.pose_times[0] > middle + _CLOCK_S or self.pose_times[-1] < end - _CLOCK_S:
            span = f"{self.pose_times[0]:g} to {self.pose_times[-1]:g} s"
            raise InputError(f"poses from {span}, turns from {self.starts[0]:g} to {end:g} s")

    def poses_at(self, share: float) -> Floats:
        """Interpolate the pose of the sensor at the same fraction of every turn.

        Parameters
        ----------
        share
            Fraction of a turn's duration that has passed: 0 is its beginning, 1 its end.

        Returns
        -------
        numpy.ndarray
            Poses, (number of turns, 4, 4), as in `poses`.
        """
        return interpolated(self.pose_times, self.poses, self.starts + share * self.turn_s)

    @property
    def seconds(self) -> float:
        """Duration of all turns, in s."""
        steps = np.diff(self.starts)
        return float(self.starts[-1] - self.starts[0] + (self.turn_s or np.median(steps)))

    @cached_property
    def points(self) -> int:
        """Total number of points in all turns."""
        return sum(map(len, self.turns))


def check_times(starts: Floats) -> None:
    """Raise InputError if turns are out of order, or if a turn is missing between two others.

    `starts` contains the times at which the turns begin, (n,), in s.
    """
    steps = np.diff(starts)
    if (back := np.flatnonzero(steps <= 0)).size:
        raise InputError(f"times run back: turn {back[0] + 1} begins before turn {back[0]}")
    if (gaps := np.flatnonzero(steps > _GAP * np.median(steps))).size:
        first, usual = gaps[0], np.median(steps)
        lasts = f"{steps[first]:g} s instead of {usual:g} s"
        raise InputError(f"a gap after turn {first}: {lasts}; select turns that follow one another")


def turn_of(returns: Returns) -> PointCloud:
    """Return a turn's returns as a cloud, with points in m in the sensor's coordinates."""
    return PointCloud(returns.points(), returns=returns)


def firing_shares(returns: Returns) -> Floats:
    """Return the times of a turn's points, computed from the azimuths at which the lasers fired.

    Parameters
    ----------
    returns
        Returns of a single turn with n returns.

    Returns
    -------
    numpy.ndarray
        Fraction of the turn's duration that had passed at each return, (n,): 0 is the beginning.
    """
    (turn,) = returns.turns
    columns, lasers, _ = returns.indices(turn)
    azimuths = returns.column_azimuths(turn)
    passed = np.mod(azimuths - azimuths[0].min(), 2 * np.pi) / (2 * np.pi)
    return np.asarray(passed[columns, lasers])


def azimuth_shares(points: Floats, original: PointCloud) -> Floats | None:
    """Return the times of a decoded turn's points, computed from the azimuths of the points.

    The times are exact for sensors whose lasers all fire at one azimuth, such as virtual sensors
    and the VLP-16. For other sensors, they are off by the lasers' different azimuths. If coding
    moved a point across the azimuth at which the turn begins, the point gets the time of the turn's
    other end.

    Parameters
    ----------
    points
        Points of the decoded turn in sensor coordinates, (n, 3), in m.
    original
        The original turn, of which only the first azimuth and the direction of rotation are used.
        They are those of its returns or, without returns, fit the times of its points.

    Returns
    -------
    numpy.ndarray or None
        Fraction of the turn's duration that had passed at each point, (n,): 0 is the beginning.
        None if the original turn has no times, or they do not follow from the azimuths.
    """
    rotation = _rotation(original)
    if rotation is None:
        return None
    begun, is_clockwise = rotation
    passed = np.mod(_azimuths(points, is_clockwise) - begun, 2 * np.pi)
    return np.asarray(passed / (2 * np.pi))


def _azimuths(points: Floats, is_clockwise: bool) -> Floats:
    return np.arctan2(points[:, 0] if is_clockwise else -points[:, 0], points[:, 1])


def _rotation(turn: PointCloud) -> tuple[float, bool] | None:
    """Return the azimuth at which a turn begins, and whether the sensor rotates clockwise."""
    if turn.returns is not None:
        (one,) = turn.returns.turns
        return float(turn.returns.column_azimuths(one)[0].min()), turn.returns.beams.clockwise
    if (shares := turn.fields.get(TURN_SHARE)) is None:
        return None
    means = {
        is_clockwise: np.exp(1j * (_azimuths(turn.xyz, is_clockwise) - 2 * np.pi * shares)).mean()
        for is_clockwise in (True, False)
    }
    is_clockwise = bool(abs(means[True]) > abs(means[False]))
    mean = means[is_clockwise]
    return (float(np.angle(mean)) - _EARLIER, is_clockwise) if abs(mean) > _LEAST_FIT else None


def timed_by_azimuth(turn: PointCloud, original: PointCloud) -> PointCloud | None:
    """Add times, computed by `azimuth_shares`, to the points of a decoded turn.

    Parameters
    ----------
    turn
        The decoded turn.
    original
        The turn before coding, with its returns or times.

    Returns
    -------
    PointCloud or None
        The decoded points with the field `TURN_SHARE`; None if azimuths give no times.
    """
    shares = azimuth_shares(turn.xyz, original)
    return None if shares is None else PointCloud(turn.xyz, fields={TURN_SHARE: shares})


def shares_of(turn: PointCloud) -> Floats | None:
    """Return the times of a turn's points, or None if the turn has neither returns nor times.

    The times come from the turn's returns or, for points without returns, from the field
    `TURN_SHARE`.

    Returns
    -------
    numpy.ndarray or None
        Fraction of the turn's duration that had passed at each point, (n,): 0 is the beginning.
    """
    if turn.returns is not None:
        return firing_shares(turn.returns)
    return turn.fields.get(TURN_SHARE)


def write_drive(path: Path, drive: Drive) -> None:
    """Write a drive as an archive; equal drives give equal bytes."""
    described = {"starts": drive.starts.tolist(), "turn_s": drive.turn_s, "about": drive.about}
    members = {
        _POSES: tum_bytes(drive.pose_times, drive.poses),
        _ABOUT: json_bytes(described),
        **dict(_turn_members(drive)),
    }
    write_archive(path, members)


def _turn_members(drive: Drive) -> Iterator[tuple[str, bytes]]:
    with TemporaryDirectory() as folder:
        table = Path(folder, "turn.parquet")
        for number, turn in enumerate(drive.turns):
            if turn.returns is None:
                times = {TURN_SHARE: turn.fields[TURN_SHARE]} if TURN_SHARE in turn.fields else {}
                yield f"{number:04d}.ply", cloud_bytes(PointCloud(turn.xyz, fields=times))
            else:
                write_firings(table, turn.returns)
                yield f"{number:04d}.parquet", table.read_bytes()


def read_drive(path: Path) -> Drive:
    """Read a drive from an archive; raise InputError if the file is no valid archive of a drive."""
    members = read_archive(path)
    with naming(path):
        if not {_POSES, _ABOUT} <= members.keys():
            raise InputError(f"not a drive: it lacks {_POSES} or {_ABOUT}")
        value = object_of(members.pop(_ABOUT), _ABOUT)
        described = parsed(_Description, value, _ABOUT)
        times, poses = poses_of(members.pop(_POSES))
        if times is None:
            raise InputError(f"{_POSES}: its poses have no times")
        turns = tuple(_read_turns(members))
        starts = np.array(described.starts)
        return Drive(turns, starts, described.turn_s, times, poses, value["about"])


def _read_turns(members: Mapping[str, bytes]) -> Iterator[PointCloud]:
    with TemporaryDirectory() as folder:
        for name, data in members.items():
            file = Path(folder, Path(name).name)
            file.write_bytes(data)
            yield turn_of(read_firings(file)) if file.suffix == ".parquet" else read_cloud(file)
            file.unlink()

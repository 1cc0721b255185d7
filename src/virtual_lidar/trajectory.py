"""Trajectories: poses over time, read from files or made from a few numbers."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, NonNegativeFloat, PositiveFloat

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats
from pointkit.models import Model
from pointkit.yaml_files import read_yaml

Row = tuple[float, ...]

_ANGLES, _QUATERNION = 7, 8
_FORM = "needs rows of t, x, y, z, yaw, pitch, roll or of t, x, y, z, qw, qx, qy, qz"


@dataclass(frozen=True)
class Poses:
    """Poses of a sensor at several times: where it is and how it is oriented.

    Parameters
    ----------
    rotations
        Rotation matrices from sensor to world coordinates, (..., 3, 3).
    positions
        Positions, (..., 3), m.
    """

    rotations: Floats
    positions: Floats


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion of a sensor, given by its poses at n times.

    Parameters
    ----------
    times
        Times of the poses in increasing order, (n,), s.
    positions
        Positions, (n, 3), m.
    quaternions
        Unit quaternions (w, x, y, z), (n, 4), which rotate from sensor coordinates (x right, y
        forward, z up) to the world.
    """

    times: Floats
    positions: Floats
    quaternions: Floats

    def at(self, times: Floats) -> Poses:
        """Return the poses at the given times, interpolated between the known poses.

        Positions are interpolated linearly, and rotations by spherical linear interpolation. Before
        the first pose and after the last one the sensor stands still.

        Parameters
        ----------
        times
            Times in s, in an array of any shape.

        Returns
        -------
        Poses
            Rotations (..., 3, 3) and positions (..., 3), where ... is the shape of `times`.
        """
        if len(self.times) == 1:
            first = np.zeros(times.shape, dtype=np.intp)
            return Poses(_matrices(self.quaternions[first]), self.positions[first])
        after = np.clip(np.searchsorted(self.times, times, side="right"), 1, len(self.times) - 1)
        start, end = self.times[after - 1], self.times[after]
        share = np.clip((times - start) / (end - start), 0, 1)[..., None]
        positions = (1 - share) * self.positions[after - 1] + share * self.positions[after]
        turned = _slerp(self.quaternions[after - 1], self.quaternions[after], share)
        return Poses(_matrices(turned), positions)


def trajectory_from_rows(rows: Sequence[Row]) -> Trajectory:
    """Make a trajectory from rows of numbers, one row for each pose.

    The angles yaw, pitch and roll rotate the sensor first by yaw about z (counter-clockwise seen
    from above), then by pitch about its own x axis (upwards positive), then by roll about its own y
    axis (right side down positive).

    Parameters
    ----------
    rows
        Each row has the time (s), the position x, y, z (m), and the orientation: either the angles
        yaw, pitch, roll (degrees), or a unit quaternion w, x, y, z.

    Returns
    -------
    Trajectory
        The trajectory through these poses.

    Raises
    ------
    InputError
        A row is not of this form, or the times do not increase.
    """
    lengths = {len(row) for row in rows}
    if lengths not in ({_ANGLES}, {_QUATERNION}):
        raise InputError(f"trajectory {_FORM}")
    values = np.array(rows, dtype=np.float64)
    if (np.diff(values[:, 0]) <= 0).any():
        raise InputError("trajectory has times that do not increase")
    turns = values[:, 4:] if lengths == {_QUATERNION} else _quaternions(values[:, 4:])
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    if (np.abs(length - 1) > 1e-3).any():
        raise InputError("trajectory has a quaternion that is not of length 1")
    return Trajectory(values[:, 0], values[:, 1:4], turns / length)


def read_rows(path: Path) -> tuple[Row, ...]:
    """Read the rows of a trajectory from a file, in the form that `trajectory_from_rows` takes.

    Parameters
    ----------
    path
        A CSV file, with or without a header, or a YAML file with a list of lists.

    Returns
    -------
    tuple
        One tuple of numbers for each pose.

    Raises
    ------
    InputError
        A row is not valid. The message names its line or the number of the pose.
    """
    if path.suffix.lower() == ".csv":
        return _checked(_csv_rows(path), path)
    rows = read_yaml(path)
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise InputError(f"{path}: expected a list of poses, each a list of numbers")
    return _checked(((f"pose {number}", row) for number, row in enumerate(rows, start=1)), path)


def _csv_rows(path: Path) -> Iterator[tuple[str, Sequence[Any]]]:
    reader = csv.reader(read_bytes(path).decode("utf-8-sig", errors="replace").splitlines())
    try:
        for number, row in enumerate(reader):
            if row and (number or any(map(_is_number, row))):
                yield f"line {reader.line_num}", row
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: not CSV ({error})") from error


def _checked(rows: Iterable[tuple[str, Sequence[Any]]], path: Path) -> tuple[Row, ...]:
    poses: list[Row] = []
    for place, row in rows:
        if not all(map(_is_number, row)):
            raise InputError(f"{path}: {place} is not a row of numbers")
        values = tuple(map(float, row))
        if not np.isfinite(values).all():
            raise InputError(f"{path}: {place} has a number that is not finite")
        if len(values) not in ({len(poses[0])} if poses else (_ANGLES, _QUATERNION)):
            raise InputError(f"{path}: {place} has {len(values)} numbers: it {_FORM}")
        if poses and values[0] <= poses[-1][0]:
            raise InputError(f"{path}: {place} is not later than the one before it")
        poses.append(values)
    if not poses:
        raise InputError(f"{path}: has no poses")
    return tuple(poses)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return False
    try:
        float(value)
    except ValueError:
        return False
    return True


def _quaternions(degrees: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_euler("ZXY", np.radians(degrees))
    return np.asarray(turns.as_quat(scalar_first=True))


# scipy's Slerp and as_matrix differ from these two by some 1e-15, which would change moving scans.
def _slerp(start: Floats, end: Floats, share: Floats) -> Floats:
    cosine = (start * end).sum(axis=-1, keepdims=True)
    end = np.where(cosine < 0, -end, end)
    arc = np.arccos(np.clip(np.abs(cosine), 0, 1))
    # For such a small arc the error of linear interpolation is below its square.
    near = arc < 1e-6
    sine = np.sin(np.where(near, 1.0, arc))
    first = np.where(near, 1 - share, np.sin((1 - share) * arc) / sine)
    second = np.where(near, share, np.sin(share * arc) / sine)
    turned = first * start + second * end
    return np.asarray(turned / np.linalg.norm(turned, axis=-1, keepdims=True))


def _matrices(quaternions: Floats) -> Floats:
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


_STEP_S, _SUBSTEPS = 0.05, 20
_FORWARD_DEG = 90.0
"""Direction of the sensor's forward axis, y, at yaw 0, counter-clockwise from x."""


class Motion(Model):
    """A simple motion of a level sensor on a vehicle, described by a few numbers.

    The sensor always faces the direction of travel. It first stands still, then accelerates to its
    speed; it may also stop at regular intervals. After a path of s metres, its heading in degrees
    is ``heading_deg + bend_deg_per_m * s + swing_deg * cos(2 pi s / swing_m)``.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    duration_s: PositiveFloat
    """Time from the first to the last pose."""
    speed_m_s: PositiveFloat
    """Highest speed."""
    acceleration_m_s2: PositiveFloat = 3.0
    """Acceleration, and deceleration before stops."""
    rest_s: NonNegativeFloat = 0.5
    """Time (s) for which the sensor stands still before it starts to move."""
    stop_every_s: PositiveFloat | None = None
    """Period of stop and go: in its second half, the sensor slows down and stands; by default it
    never stops."""
    start: tuple[float, float] = (0.0, 0.0)
    """First position, x and y in m, relative to the scan's origin."""
    heading_deg: float = 0.0
    """Mean direction of travel in degrees, counter-clockwise from the x axis."""
    swing_deg: float = 0.0
    """By how many degrees the heading swings to each side of its mean."""
    swing_m: PositiveFloat = 25.0
    """Length of the path, in m, in which the heading swings to both sides once."""
    bend_deg_per_m: float = 0.0
    """Turn of the mean heading per metre: 57.3 / radius, positive to the left."""

    def rows(self) -> tuple[tuple[float, ...], ...]:
        """Return a pose every 0.05 s, as rows in the form that `trajectory_from_rows` takes."""
        (x, y), path, speed, rows = self.start, 0.0, 0.0, []
        step = _STEP_S / _SUBSTEPS
        for number in range(math.ceil(self.duration_s / _STEP_S - 1e-9) + 1):
            time = number * _STEP_S
            pose = (time, x, y, 0.0, self._heading(path) - _FORWARD_DEG, 0.0, 0.0)
            rows.append(tuple(round(value, 6) + 0.0 for value in pose))
            for part in range(_SUBSTEPS):
                change = self._wanted_speed(time + part * step) - speed
                most = self.acceleration_m_s2 * step
                speed += min(max(change, -most), most)
                heading = math.radians(self._heading(path + speed * step / 2))
                x, y = x + speed * step * math.cos(heading), y + speed * step * math.sin(heading)
                path += speed * step
        return tuple(rows)

    def _heading(self, path: float) -> float:
        swing = self.swing_deg * math.cos(2 * math.pi * path / self.swing_m)
        return self.heading_deg + self.bend_deg_per_m * path + swing

    def _wanted_speed(self, time: float) -> float:
        driven = time - self.rest_s
        if driven < 0:
            return 0.0
        period = self.stop_every_s
        return self.speed_m_s if period is None or driven % period < period / 2 else 0.0

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats
from pointkit.yaml_files import read_yaml

Row = tuple[float, ...]

_ANGLES, _QUATERNION = 7, 8
_FORM = "needs rows of t, x, y, z, yaw, pitch, roll or of t, x, y, z, qw, qx, qy, qz"


@dataclass(frozen=True)
class Poses:
    """Rotations from the sensor to the world (..., 3, 3), and positions (..., 3), m."""

    rotations: Floats
    positions: Floats


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses at times (n,), s: positions (n, 3), m, and unit quaternions wxyz (n, 4).

    Quaternions rotate from sensor coordinates (x right, y forward, z up) to the world.
    """

    times: Floats
    positions: Floats
    quaternions: Floats

    def at(self, times: Floats) -> Poses:
        """Interpolate positions linearly and rotations by slerp; clamp beyond the ends."""
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
    """Convert rows of t, x, y, z and yaw, pitch, roll (degrees) or a quaternion wxyz.

    Rotations are intrinsic: yaw about z, counter-clockwise seen from above; then pitch about x,
    upwards positive; then roll about y, right side down positive.
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
    """Read the rows of a trajectory from a CSV file (header optional) or a YAML list."""
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

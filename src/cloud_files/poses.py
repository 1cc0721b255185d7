"""Reading and writing of the poses of a moving sensor, in the file formats of TUM and KITTI.

A line of a TUM file is a time, a position and a quaternion (t x y z qx qy qz qw). A line of a KITTI
file is the first three rows of a 4x4 matrix.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pointkit.errors import InputError, naming
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats

_TUM, _KITTI = 8, 12
_NOT_UNIT, _NOT_ROTATION = 1e-3, 1e-2
_STANDS_M = 1.0
"""Length of a path, in m, that tells nothing about axes."""
_SAME_AXES = "a calib.txt with Tr: 1 0 0 0 0 1 0 0 0 0 1 0"


def read_poses(path: str | Path) -> tuple[Floats | None, Floats]:
    """Read the poses of a sensor from a file in TUM's or KITTI's format.

    Returns
    -------
    tuple
        The times (n,) in seconds, or None for KITTI's format, which has no times; and the matrices
        (n, 4, 4) that transform from sensor to world coordinates, in metres.

    Raises
    ------
    InputError
        A line is not a pose, or the times do not increase.
    """
    with naming(path):
        return poses_of(read_bytes(Path(path)))


def files_of_poses(path: str | Path) -> list[Path]:
    """Return the files from which `read_lidar_poses` reads: the file of poses and its calibration.

    The calibration is a ``calib.txt`` beside the file or, as in KITTI, ``sequences/00/calib.txt``
    for ``poses/00.txt``. If there is none, only the file itself is returned.
    """
    path = Path(path)
    places = (path.parent, path.parent.parent / "sequences" / path.stem)
    found = [place / "calib.txt" for place in places if (place / "calib.txt").is_file()]
    return [path, *found[:1]]


def read_lidar_poses(path: str | Path) -> tuple[Floats | None, Floats]:
    """Read the poses of a LiDAR from a file in TUM's or KITTI's format.

    KITTI's poses are those of a camera, which moves along its z axis. Such poses are converted to
    poses of the LiDAR by the ``calib.txt`` that belongs to them (`files_of_poses`). Poses that move
    along their x or y axis are taken to be those of the LiDAR.

    Returns
    -------
    tuple
        Times and matrices as in `read_poses`. The matrices transform from LiDAR coordinates to
        fixed coordinates.

    Raises
    ------
    InputError
        A line is not a pose, the times do not increase, or there is no ``calib.txt`` although the
        poses move along their z axis, as those of a camera do.
    """
    times, poses = read_poses(path)
    right, forward, up = np.abs(_motion(poses))
    _, *calibrations = files_of_poses(path)
    if calibrations and up >= max(right, forward):
        camera = read_kitti_calibration(calibrations[0])
        return times, np.linalg.inv(camera) @ poses @ camera
    if up > max(right, forward, _STANDS_M):
        fault = "these poses move along z, as those of KITTI's camera: put its calib.txt beside"
        raise InputError(f"{path}: {fault} them (if they are the LiDAR's: {_SAME_AXES})")
    return times, poses


def _motion(poses: Floats) -> Floats:
    """Return the sum of the steps (3,) from pose to pose, in m along the axes of the sensor."""
    steps = np.diff(poses[:, :3, 3], axis=0)
    return np.asarray(np.einsum("nij,ni->j", poses[:-1, :3, :3], steps))


def poses_of(data: bytes) -> tuple[Floats | None, Floats]:
    """Return the times and poses of a file's content, as `read_poses` does."""
    lines = data.decode("utf-8-sig", errors="replace").splitlines()
    rows = [_numbers(k, line) for k, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    widths = {len(row) for row in rows}
    if widths not in ({_TUM}, {_KITTI}):
        raise InputError("no poses: lines have 8 numbers (TUM) or 12 (KITTI)")
    values, poses = np.array(rows), np.tile(np.eye(4), (len(rows), 1, 1))
    if widths == {_KITTI}:
        poses[:, :3] = values.reshape(-1, 3, 4)
        _check_rotations(poses[:, :3, :3])
        return None, poses
    from scipy.spatial.transform import Rotation

    if (back := np.flatnonzero(np.diff(values[:, 0]) <= 0)).size:
        raise InputError(f"times run back: pose {back[0] + 2} is not later than the one before it")
    if (np.abs(np.linalg.norm(values[:, 4:], axis=1) - 1) > _NOT_UNIT).any():
        raise InputError("a quaternion is not of length 1")
    poses[:, :3, :3] = Rotation.from_quat(values[:, 4:]).as_matrix()
    poses[:, :3, 3] = values[:, 1:4]
    return values[:, 0], poses


def tum_bytes(times: Floats, poses: Floats) -> bytes:
    """Return the content of a file with the given poses in TUM's format.

    Parameters
    ----------
    times
        Times, (n,), s.
    poses
        Matrices (n, 4, 4) that transform from sensor to world coordinates, in metres.
    """
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    rows = np.column_stack([times, poses[:, :3, 3], turned])
    lines = [" ".join(f"{value:.9f}" for value in row) for row in rows + 0.0]
    return ("\n".join(lines) + "\n").encode()


def kitti_bytes(poses: Floats) -> bytes:
    """Return the content of a file with the given poses in KITTI's format.

    Parameters
    ----------
    poses
        Matrices (n, 4, 4) that transform from sensor to world coordinates, in metres.
    """
    rows = poses[:, :3].reshape(-1, _KITTI) + 0.0
    return "".join(" ".join(f"{value:.9f}" for value in row) + "\n" for row in rows).encode()


def read_kitti_calibration(path: Path) -> Floats:
    """Read the matrix (4, 4) that transforms from the LiDAR's frame to that of the first camera.

    It is the line ``Tr:`` of the ``calib.txt`` of one of KITTI's sequences. Raises InputError if
    there is no such line of 12 numbers.
    """
    lines = read_bytes(path).decode("utf-8", errors="replace").splitlines()
    with naming(path):
        for number, line in enumerate(lines, 1):
            name, _, values = line.partition(":")
            if name == "Tr" and len(numbers := _numbers(number, values)) == _KITTI:
                return np.vstack([np.reshape(numbers, (3, 4)), [0.0, 0.0, 0.0, 1.0]])
        raise InputError("no line 'Tr:' with 12 numbers, from the LiDAR to the camera")


def read_times(path: Path) -> Floats:
    """Read times (n,), in seconds, from a file with one time in each line, as KITTI's are."""
    lines = read_bytes(path).decode("utf-8", errors="replace").split("\n")
    with naming(path):
        rows = [_numbers(number, line) for number, line in enumerate(lines, 1) if line.strip()]
        if any(len(row) != 1 for row in rows):
            raise InputError("expected one time in each line")
        return np.array([value for row in rows for value in row])


def _numbers(number: int, line: str) -> list[float]:
    try:
        values = [float(word) for word in line.replace(",", " ").split()]
    except ValueError:
        raise InputError(f"line {number} is not a row of numbers") from None
    if not np.isfinite(values).all():
        raise InputError(f"line {number} has a number that is not finite")
    return values


def _check_rotations(matrices: Floats) -> None:
    product = matrices @ matrices.transpose(0, 2, 1)
    if (np.abs(product - np.eye(3)) > _NOT_ROTATION).any() or (np.linalg.det(matrices) < 0).any():
        raise InputError("a pose is not a rotation and a position")

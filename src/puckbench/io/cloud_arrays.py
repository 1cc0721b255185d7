"""Clouds as bare arrays: NumPy's files, and the frames of KITTI and nuScenes."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.io.point_columns import Columns, named_columns

_POINTS = ("xyz", "points", "pos", "coords", "vertices", "arr_0")
_PARTS = {
    "normals": ("nx", "ny", "nz"),
    "colours": ("red", "green", "blue"),
    "colors": ("red", "green", "blue"),
    "rgb": ("red", "green", "blue"),
}
_MOST_COLUMNS = 256
"""Columns of an array: no points have as many values, but an array on its side does."""
_FARTHEST_M = 1e5
"""No sensor of such frames sees farther: other numbers are those of another kind of file."""


def read_npy(path: Path) -> Columns:
    """Read an array (n, 3 or more), one with named fields, or an archive of such (NPZ)."""
    found = _loaded(path)
    if isinstance(found, Mapping):
        return _archived(found, path)
    return _columns(found, path)


def read_frame(path: Path) -> Columns:
    """Read a frame of KITTI: x, y, z, intensity in float32; of nuScenes (.pcd.bin) also the ring.

    Raises
    ------
    InputError
        The file is missing, cut short, or holds no coordinates of such a sensor.
    """
    names = ["x", "y", "z", "intensity"]
    if path.name.lower().endswith(".pcd.bin"):
        names.append("ring")
    data = read_bytes(path)
    if len(data) % (4 * len(names)):
        size = 4 * len(names)
        raise InputError(f"{path}: truncated: {len(data)} bytes are not whole points of {size}")
    rows = np.frombuffer(data, dtype="<f4").reshape(-1, len(names))
    with np.errstate(invalid="ignore"):
        if (np.abs(rows[:, :3]) > _FARTHEST_M).any():
            raise InputError(f"{path}: no frame of a LiDAR: coordinates beyond {_FARTHEST_M:g} m")
    return {name: rows[:, place] for place, name in enumerate(names)}


def _loaded(path: Path) -> Any:
    data = io.BytesIO(read_bytes(path))
    try:
        found = np.load(data, allow_pickle=False)
        return {name: found[name] for name in found.files} if hasattr(found, "files") else found
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, MemoryError) as error:
        fault = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable NumPy file ({fault})") from error


def _columns(array: NDArray[Any], path: Path) -> Columns:
    """Columns of one array: those that it names, or the customary ones."""
    if array.dtype.names:
        return {name: array[name].reshape(len(array), -1).squeeze(1) for name in array.dtype.names}
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: expected numbers of shape (n, 3), got {array.dtype} {array.shape}"
        )
    if array.shape[1] > _MOST_COLUMNS:
        raise InputError(f"{path}: {array.shape[1]} columns: points stand in rows, (n, 3 or more)")
    return named_columns(array)


def _archived(arrays: Mapping[str, NDArray[Any]], path: Path) -> Columns:
    """Columns of the arrays of an archive, whose points stand in one of them or in x, y and z."""
    name = next((name for name in _POINTS if name in arrays), None)
    if name is None and len(arrays) == 1:
        (name,) = arrays
    columns = {} if name is None else _columns(arrays[name], path)
    points = len(next(iter(columns.values()))) if columns else None
    for other, values in arrays.items():
        if other == name or not values.ndim or (points is not None and len(values) != points):
            continue
        if other in _PARTS and values.shape[1:] == (3,):
            columns |= dict(zip(_PARTS[other], values.T, strict=True))
        else:
            columns[other] = values
    return columns

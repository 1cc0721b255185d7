"""LAS 1.2 (ASPRS), point format 1, and its compressed form LAZ, by laspy and lazrs.

The laser stands in the user data, the frame or turn in the point source id, the timestamp in the
GPS time.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from datetime import date
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench import __version__
from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes, write_bytes

_STEP_M = 1e-4
# The same points give the same bytes on any day.
_DATE = date(2000, 1, 1)
# LAZ packs no scan of a LiDAR to less than this share; a header that claims more is damaged.
_MOST_COMPRESSION = 1000
_NAMES = {
    "intensity": "reflectivity",
    "user_data": "laser_id",
    "point_source_id": "turn",
    "gps_time": "timestamp",
}


def write_las(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write a LAS file, or by the suffix a LAZ file; coordinates in steps of 0.1 mm."""
    import laspy

    packed = BytesIO()
    _las_data(columns).write(
        packed, do_compress=path.suffix.lower() == ".laz", laz_backend=laspy.LazBackend.Lazrs
    )
    write_bytes(path, packed.getvalue())


def read_las(path: Path) -> dict[str, NDArray[Any]]:
    """Read the points of a LAS or LAZ file as the columns that `write_las` takes.

    Raises
    ------
    InputError
        The file is missing or damaged.
    """
    points = _read_points(path)
    dimensions = set(points.point_format.dimension_names)
    known = {name for name in _NAMES if name in dimensions}
    return {**_coordinates(points), **{_NAMES[name]: np.asarray(points[name]) for name in known}}


def read_las_points(path: Path) -> dict[str, NDArray[Any]]:
    """Read the points of a LAS or LAZ file with all of their dimensions that are not 0 throughout.

    Raises
    ------
    InputError
        The file is missing or damaged.
    """
    points = _read_points(path)
    others = {
        name: np.asarray(points[name])
        for name in points.point_format.dimension_names
        if name not in {"X", "Y", "Z"}
    }
    return {**_coordinates(points), **{name: part for name, part in others.items() if part.any()}}


def _coordinates(points: Any) -> dict[str, NDArray[np.float64]]:
    return {axis: np.asarray(points[axis], dtype=np.float64) for axis in "xyz"}


def _read_points(path: Path) -> Any:
    import laspy
    from lazrs import LazrsError

    data = read_bytes(path)
    try:
        with laspy.open(BytesIO(data)) as reader:
            header = reader.header
            if header.point_count * header.point_format.size > _MOST_COMPRESSION * len(data):
                raise InputError(f"{path}: not a readable LAS file (it is cut short)")
            points = reader.read()
            _coordinates(points)
    except (laspy.LaspyException, LazrsError, struct.error, ValueError, OverflowError) as error:
        fault = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable LAS file ({fault})") from error
    return points


def _las_data(columns: Mapping[str, NDArray[Any]]) -> Any:
    import laspy

    xyz = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
    offset = np.floor(xyz.min(axis=0))
    counts = np.rint((xyz - offset) / _STEP_M)
    if counts.max() > np.iinfo(np.int32).max:
        raise InputError("the points lie too far apart for LAS (more than 214 km)")
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, _STEP_M), offset
    header.creation_date, header.system_identifier = _DATE, "EXPORT"
    header.generating_software = f"puckbench {__version__}"
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(xyz), header=header))
    las.X, las.Y, las.Z = counts.astype(np.int32).T
    las.return_number[:] = las.number_of_returns[:] = 1
    las.intensity = columns.get("reflectivity", np.zeros(len(xyz)))
    las.user_data = columns["laser_id"]
    las.point_source_id = np.clip(columns["turn" if "turn" in columns else "frame"], 0, 0xFFFF)
    las.gps_time = columns["timestamp"]
    return las

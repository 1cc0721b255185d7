"""LAS 1.2 (ASPRS), point format 1, and its compressed form LAZ, by laspy and lazrs.

The laser stands in the user data, the frame or turn in the point source id, the timestamp in the
GPS time.
"""

from __future__ import annotations

import logging
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
from puckbench.core.files import write_bytes
from puckbench.io.isolated import Parsed, isolated
from puckbench.io.las_header import check_header
from puckbench.io.las_units import METRE, named, units_of

_LOG = logging.getLogger(__name__)
_STEP_M = 1e-4
# The same points give the same bytes on any day.
_DATE = date(2000, 1, 1)
_AXES = ("x", "y", "z")
_DAMAGE = (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError)
"""What laspy raises for damaged records besides its own errors."""
_LONGEST_FAULT = 120
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
    """Read the points of a LAS or LAZ file as the columns that `write_las` takes, in metres.

    Raises
    ------
    InputError
        The file is missing or damaged, or its coordinates are degrees.
    """
    columns = isolated(parse_las, path, "LAS file").columns
    kept = {**{axis: axis for axis in _AXES}, **_NAMES}
    return {kept[name]: part for name, part in columns.items() if name in kept}


def read_las_points(path: Path, convert: bool = True) -> dict[str, NDArray[Any]]:
    """Read the points of a LAS or LAZ file with all of their dimensions that are not 0 throughout.

    Parameters
    ----------
    path
        The file.
    convert
        Whether coordinates in feet or other units become metres, by the file's coordinate reference
        system; else the system is not read.

    Returns
    -------
    dict
        Coordinates under `x`, `y` and `z`, and the other dimensions by their names.

    Raises
    ------
    InputError
        The file is missing or damaged, or its coordinates are degrees.
    """
    columns = isolated(parse_las, path, "LAS file", {"convert": convert}).columns
    return {name: part for name, part in columns.items() if name in _AXES or np.count_nonzero(part)}


def parse_las(path: Path, convert: bool = True) -> Parsed:
    """As `read_las_points`, in this process and with all dimensions."""
    import laspy
    from lazrs import LazrsError

    check_header(path)
    try:
        with laspy.open(path, laz_backend=laspy.LazBackend.LazrsParallel) as reader:
            lengths = _lengths(reader.header, path) if convert else None
            points = reader.read_points(-1)
        names = [name for name in points.point_format.dimension_names if name.lower() not in _AXES]
        columns = {name: np.asarray(points[name]) for name in names}
        return Parsed({**_coordinates(points, lengths), **columns})
    except (laspy.LaspyException, LazrsError, struct.error, OSError, *_DAMAGE) as error:
        fault = " ".join(str(error).split())[:_LONGEST_FAULT]
        raise InputError(f"{path}: not a readable LAS file (damaged or cut: {fault})") from error


def _lengths(header: Any, path: Path) -> tuple[float, float, float] | None:
    """Lengths in metres of the units of x, y and z; None for metres."""
    from pyproj.exceptions import CRSError

    try:
        units = units_of(header)
    except CRSError:
        _LOG.warning("%s: its coordinate reference system is not readable: metres assumed", path)
        return None
    if units.is_degrees:
        raise InputError(f"{path}: its coordinates are degrees: project it first (pdal, las2las)")
    across, up = units.horizontal or METRE, units.vertical or METRE
    if across == up == METRE:
        return None
    what = named(across) if across == up else f"{named(across)} and its heights in {named(up)}"
    _LOG.warning("%s: its coordinates are in %s: converted to metres", path, what)
    return across, across, up


def _coordinates(points: Any, lengths: tuple[float, ...] | None) -> dict[str, NDArray[np.float64]]:
    axes = {axis: np.asarray(points[axis], dtype=np.float64) for axis in _AXES}
    if lengths is None:
        return axes
    return {axis: axes[axis] * length for axis, length in zip(_AXES, lengths, strict=True)}


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

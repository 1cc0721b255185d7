"""LAS 1.2 (ASPRS), point format 1, and its compressed form LAZ.

Layout after the LAS Specification 1.2 (ASPRS, 2008), tables 1 and 7. The laser stands in the user
data, the frame or turn in the point source id, the timestamp in the GPS time.
"""

from __future__ import annotations

import struct
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from puckbench import __version__
from puckbench.core.errors import InputError
from puckbench.core.files import write_bytes
from puckbench.geometry.cloud import Floats
from puckbench.io.point_formats import Rows

_HEADER_BYTES = 227
_STEP_M = 1e-4
_RETURN = 0b00_001_001
"""First of one return."""
_POINT = np.dtype(
    [
        ("xyz", "<i4", 3),
        ("intensity", "<u2"),
        ("returns", "u1"),
        ("classification", "u1"),
        ("scan_angle", "i1"),
        ("user_data", "u1"),
        ("source", "<u2"),
        ("gps_time", "<f8"),
    ]
)


def write_las(path: Path, rows: Rows) -> None:
    """Write a LAS file; coordinates in steps of 0.1 mm."""
    write_bytes(path, las_bytes(rows))


def write_laz(path: Path, rows: Rows) -> None:
    """Write a LAZ file with laspy and lazrs; InputError when they are not installed."""
    try:
        laspy: Any = import_module("laspy")
        import_module("lazrs")
    except ImportError as error:
        raise InputError(
            f"{path}: LAZ needs two packages: pip install laspy lazrs (or write .las)"
        ) from error
    packed = BytesIO()
    laspy.read(BytesIO(las_bytes(rows))).write(
        packed, do_compress=True, laz_backend=laspy.LazBackend.Lazrs
    )
    write_bytes(path, packed.getvalue())


def las_bytes(rows: Rows) -> bytes:
    """The bytes of a LAS file."""
    xyz = np.column_stack([rows[axis] for axis in "xyz"]).astype(np.float64)
    offset = np.floor(xyz.min(axis=0))
    counts = np.rint((xyz - offset) / _STEP_M)
    if counts.max() > np.iinfo(np.int32).max:
        raise InputError("the points lie too far apart for LAS (more than 214 km)")
    names = rows.dtype.names or ()
    points = np.zeros(len(rows), dtype=_POINT)
    points["xyz"] = counts
    points["intensity"] = rows["reflectivity"] if "reflectivity" in names else 0
    points["returns"] = _RETURN
    points["user_data"] = rows["laser_id"]
    points["source"] = np.clip(rows["turn" if "turn" in names else "frame"], 0, 0xFFFF)
    points["gps_time"] = rows["timestamp"]
    reached = offset + points["xyz"] * _STEP_M
    return _header(len(points), offset, reached.min(axis=0), reached.max(axis=0)) + points.tobytes()


def _header(points: int, offset: Floats, low: Floats, high: Floats) -> bytes:
    text = f"puckbench {__version__}".encode()
    first = struct.pack("<4sHH16sBB", b"LASF", 0, 0, bytes(16), 1, 2)
    made = struct.pack("<32s32sHH", b"EXPORT", text, 1, 2000)
    sizes = struct.pack("<HIIBHI", _HEADER_BYTES, _HEADER_BYTES, 0, 1, _POINT.itemsize, points)
    by_return = struct.pack("<5I", points, 0, 0, 0, 0)
    bounds = np.column_stack([high, low]).ravel()
    return first + made + sizes + by_return + struct.pack("<12d", *[_STEP_M] * 3, *offset, *bounds)

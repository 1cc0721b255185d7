"""Rows to export: the points of a scan or a capture with what is known of each return."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.io.point_formats import Rows
from puckbench.lidar.recordings.capture_table import CaptureTable
from puckbench.lidar.scan_table import ScanTable

_SCAN = ("timestamp", "frame", "laser_id", "yaw", "pitch", "incidence", "object_id", "primitive_id")
_NORMAL = ("nx", "ny", "nz")
_CAPTURE = ("timestamp", "turn", "laser_id", "return_kind", "azimuth", "elevation", "distance")


def scan_rows(table: ScanTable, clean: bool) -> Rows:
    """Measured (or, when `clean`, true) points of a scan, in world coordinates."""
    suffix = "" if clean else "_noisy"
    measured = {axis: table[axis + suffix] for axis in "xyz"}
    known = {name: table[name] for name in (*_SCAN, *_NORMAL)}
    rest = {"reflectivity"} & set(table.columns)
    return _joined(
        {
            **measured,
            "distance": table["distance" + suffix],
            **known,
            **{name: table[name] for name in rest},
        }
    )


def capture_rows(table: CaptureTable) -> Rows:
    """Points of a real capture, in the sensor's frame."""
    return _joined({name: table[name] for name in ("x", "y", "z", *_CAPTURE, "reflectivity")})


def _joined(columns: dict[str, NDArray[Any]]) -> Rows:
    rows = np.empty(len(columns["x"]), dtype=[(name, part.dtype) for name, part in columns.items()])
    for name, part in columns.items():
        rows[name] = part
    return rows

"""Clouds of another decoder (CSV, PLY, PCD, LAS) that tell each point's laser, as returns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, check_points
from puckbench.io.csv_columns import read_csv
from puckbench.io.las import read_las
from puckbench.io.pcd import read_pcd
from puckbench.io.ply import read_ply
from puckbench.lidar.recordings.returns import RETURN_COLUMNS, RecordedReturns
from puckbench.lidar.sensor import Sensor, load_sensor

_READERS = {
    ".csv": read_csv,
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".las": read_las,
    ".laz": read_las,
}
SUFFIXES = tuple(_READERS)
_IDS = ("laser_id", "laser", "label")
# ROS drivers number the lasers from the lowest to the highest.
_RANKS = ("ring", "channel")
_TIMES = ("timestamp", "time")
_REFLECTIVITIES = ("reflectivity", "intensity")

Columns = Mapping[str, NDArray[Any]]


def read_points(path: Path, sensor: Sensor | None = None) -> RecordedReturns:
    """Points x, y, z (sensor's frame) with a laser column, as a table; m.

    Laser ids are taken from `laser_id`, `laser` or `label`, or from `ring` or `channel`, which
    count lasers by elevation. The coordinates stay as they are, in the file's axes and with or
    without the vertical correction; azimuths count clockwise from y, distances are those of the
    horizontal range at the laser's nominal elevation. Unknown: turn and kind of return (0).

    Raises InputError when the file is damaged, empty, or lacks one of these columns.
    """
    device = sensor or load_sensor("vlp16")
    columns = _READERS[path.suffix.lower()](path)
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"no column {', '.join(missing)} of numbers")
    with np.errstate(invalid="ignore"):
        xyz = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
    check_points(xyz, str(path))
    laser = _lasers(columns, device)
    elevation = np.radians(device.laser_elevation_deg)[laser]
    known = {
        "timestamp": _first(columns, _TIMES, len(xyz)),
        "laser_id": laser,
        "azimuth": np.mod(np.arctan2(xyz[:, 0], xyz[:, 1]), 2 * np.pi),
        "elevation": elevation,
        "distance": np.hypot(xyz[:, 0], xyz[:, 1]) / np.cos(elevation),
        "reflectivity": np.clip(np.rint(_first(columns, _REFLECTIVITIES, len(xyz))), 0, 255),
        **{axis: xyz[:, place] for place, axis in enumerate("xyz")},
    }
    unknown = np.zeros(len(xyz))
    table = {
        name: known.get(name, unknown).astype(kind) for name, (kind, *_) in RETURN_COLUMNS.items()
    }
    return RecordedReturns(table, {"sensor": device.name, "format": path.suffix[1:].lower()})


def _lasers(columns: Columns, sensor: Sensor) -> NDArray[np.intp]:
    """Laser id of each point."""
    name = next((name for name in (*_IDS, *_RANKS) if name in columns), None)
    if name is None:
        raise InputError(f"no laser column ({', '.join((*_IDS, *_RANKS))})")
    values = np.asarray(columns[name], dtype=np.float64)
    whole = np.isfinite(values) & (values == np.floor(values))
    if not (whole & (values >= 0) & (values < sensor.lasers)).all():
        raise InputError(f"column {name} has a value that is no laser of the {sensor.name}")
    lasers = values.astype(np.intp)
    return np.argsort(sensor.laser_elevation_deg)[lasers] if name in _RANKS else lasers


def _first(columns: Columns, names: tuple[str, ...], rows: int) -> Floats:
    """The first of the named columns, or zeros."""
    name = next((name for name in names if name in columns), None)
    values = np.zeros(rows) if name is None else np.asarray(columns[name], dtype=np.float64)
    if not np.isfinite(values).all():
        raise InputError(f"column {name} has a value that is not finite")
    return values

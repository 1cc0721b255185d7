from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, check_points
from puckbench.io.las import read_las
from puckbench.io.pcd import read_pcd
from puckbench.io.ply import read_ply
from puckbench.io.text import read_csv
from puckbench.lidar.recordings.returns import RETURN_COLUMNS, RecordedReturns
from puckbench.lidar.recordings.times import TimeUnit, seconds_of, unit_of
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sensors import load_sensor

_READERS = {
    ".csv": read_csv,
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".las": read_las,
    ".laz": read_las,
}
SUFFIXES = tuple(_READERS)
_IDS = ("laser_id", "laser", "label")
# ROS drivers number lasers from the lowest to the highest.
_RANKS = ("ring", "channel", "line")
LASERS = (*_IDS, *_RANKS)
TIMES = ("timestamp", "time", "time_stamp", "t", "offset_time", "gps_time")
REFLECTIVITIES = ("reflectivity", "intensity")
MOST_OFF_DEG = 0.5
"""Limit of the median angle between the points of a laser and its cone."""

Columns = Mapping[str, NDArray[Any]]


def read_points(
    path: Path, sensor: Sensor | None = None, time_unit: TimeUnit | None = None
) -> RecordedReturns:
    """Read points x, y, z (m, sensor's coordinates) with a laser column as a table of returns.

    By default, the sensor is a VLP-16, and the time unit is inferred. See `returns_of_columns`.
    """
    columns = _READERS[path.suffix.lower()](path)
    return returns_of_columns(columns, sensor or load_sensor("vlp16"), time_unit, path)


def returns_of_columns(
    columns: Columns, device: Sensor, time_unit: TimeUnit | None, path: Path
) -> RecordedReturns:
    """Convert the columns of points in a sensor's coordinates to a table of returns.

    The laser column is the first of `laser_id`, `laser`, `label`, `ring`, `channel` and `line`
    whose values, as ids or ranks by elevation, put the points on the lasers' cones. Azimuths count
    clockwise from y; distances follow from horizontal range and nominal elevation. Points at the
    origin or with all coordinates nan are left out. An integer column `turn` is kept.
    """
    columns, counts = without_missing(path, columns)
    xyz = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
    check_points(xyz, str(path))
    laser = _lasers(columns, xyz, device)
    azimuth = np.mod(np.arctan2(xyz[:, 0], xyz[:, 1]), 2 * np.pi)
    elevation = np.radians(device.laser_elevation_deg)[laser]
    values = {
        "timestamp": _seconds(path, columns, azimuth, time_unit),
        "laser_id": laser,
        "azimuth": azimuth,
        "elevation": elevation,
        "distance": np.hypot(xyz[:, 0], xyz[:, 1]) / np.cos(elevation),
        "reflectivity": np.clip(np.rint(_numbers(columns, REFLECTIVITIES)[1]), 0, 255),
        **{axis: xyz[:, place] for place, axis in enumerate("xyz")},
    }
    if "turn" in columns and columns["turn"].dtype.kind in "iu":
        values["turn"] = columns["turn"]
    unknown = np.zeros(len(xyz))
    table = {
        name: values.get(name, unknown).astype(kind) for name, (kind, *_) in RETURN_COLUMNS.items()
    }
    about = {"sensor": device.name, "format": path.suffix[1:].lower(), **counts}
    return RecordedReturns(table, about)


def without_missing(path: Path, columns: Columns) -> tuple[Columns, dict[str, int]]:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"no column {', '.join(missing)} of numbers")
    axes = [columns[axis] for axis in "xyz"]
    is_missing = np.all([np.isnan(axis) for axis in axes], axis=0)
    is_missing |= np.all([axis == 0 for axis in axes], axis=0)
    count = int(is_missing.sum())
    if not count:
        return columns, {}
    logging.getLogger(__name__).warning("%s: left out %d missing returns", path, count)
    rows = {name: part[~is_missing] for name, part in columns.items()}
    return rows, {"dropped_points": count, "missing_returns": count}


def _lasers(columns: Columns, xyz: Floats, sensor: Sensor) -> NDArray[np.intp]:
    names = [name for name in LASERS if name in columns]
    if not names:
        raise InputError(f"no laser column ({', '.join(LASERS)})")
    ids, by_rank = np.arange(sensor.lasers), np.argsort(sensor.laser_elevation_deg)
    faults = []
    for name in names:
        for order in (by_rank, ids) if name in _RANKS else (ids, by_rank):
            try:
                lasers = order[_numbered(columns[name], sensor)]
                _check_cones(xyz, lasers, sensor)
            except InputError as error:
                faults.append(f"column {name} {error}")
            else:
                return lasers
    raise InputError(faults[0])


def _numbered(column: NDArray[Any], sensor: Sensor) -> NDArray[np.intp]:
    values = np.asarray(column, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        is_laser = (values == np.floor(values)) & (values >= 0) & (values < sensor.lasers)
    if not is_laser.all():
        raise InputError(f"has a value that is not a laser of the {sensor.name}")
    return values.astype(np.intp)


def _check_cones(xyz: Floats, lasers: NDArray[np.intp], sensor: Sensor) -> None:
    """Raise InputError unless points lie on their lasers' cones, with or without height offsets."""
    level = np.hypot(xyz[:, 0], xyz[:, 1])
    corrections = np.asarray(sensor.vertical_correction_mm or np.zeros(sensor.lasers)) / 1000
    worst = []
    for height in (corrections, np.zeros(sensor.lasers)):
        seen = np.degrees(np.arctan2(xyz[:, 2] - height[lasers], level))
        off = np.abs(seen - np.asarray(sensor.laser_elevation_deg)[lasers])
        worst.append(max((float(np.median(off[lasers == k])), int(k)) for k in np.unique(lasers)))
    degrees, laser = min(worst)
    if degrees > MOST_OFF_DEG:
        raise InputError(
            f"has no lasers: points of laser {laser} lie {degrees:.1f} degrees off its cone; this"
            f" is not a recording of a {sensor.name} in its frame (another sensor: --sensor)"
        )


def _seconds(path: Path, columns: Columns, azimuth: Floats, unit: TimeUnit | None) -> Floats:
    name, times = _numbers(columns, TIMES)
    inferred = unit or unit_of(times, azimuth)
    if inferred is None:
        raise InputError(
            f"column {name} has integers whose unit cannot be inferred: add --time-unit ns"
        )
    if unit is None and inferred != "s":
        logging.getLogger(__name__).warning("%s: times in column %s: %s", path, name, inferred)
    return seconds_of(times, inferred)


def _numbers(columns: Columns, names: tuple[str, ...]) -> tuple[str, NDArray[Any]]:
    name = next((name for name in names if name in columns), "")
    values = columns[name] if name else np.zeros(len(columns["x"]))
    if not np.isfinite(values).all():
        raise InputError(f"column {name} has a value that is not finite")
    return name, values

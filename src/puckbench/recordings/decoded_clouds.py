from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.las import read_las
from cloud_files.pcd import read_pcd
from cloud_files.ply import read_ply
from cloud_files.text import read_csv
from pointkit.errors import InputError, counted
from pointkit.geometry.cloud import Floats, check_points
from pointkit.lidar.return_table import RETURN_COLUMNS, UNKNOWN, ReturnTable
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.times import TimeUnit, falls, fault_of, largest_leap, seconds_of, unit_of
from puckbench.recordings.table_turns import ranks_of_lasers

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
"""Largest median angle, in degrees, between a laser's points and the cone that the laser draws."""
_MOST_OFF = 0.1
"""Share of points that may lie off the cones of their lasers without a warning."""
_BRIGHTEST = 255

Columns = Mapping[str, NDArray[Any]]
_log = logging.getLogger(__name__)


def read_points(
    path: Path, sensor: Sensor | None = None, time_unit: TimeUnit | None = None
) -> ReturnTable:
    """Read a cloud with a laser column as a table of a sensor's returns.

    The coordinates must be in m, in the sensor's frame (x right, y forward, z up). Points at the
    origin, or whose coordinates are all nan, are left out as missing returns. `returns_of_columns`
    says how the columns are interpreted.

    Parameters
    ----------
    path
        A cloud with one of the suffixes `SUFFIXES`.
    sensor
        The sensor that recorded the cloud; by default, a VLP-16.
    time_unit
        Unit of the column of times; by default, it is inferred from the values.

    Returns
    -------
    ReturnTable
        A row for each point.

    Raises
    ------
    InputError
        The cloud has no coordinates or no lasers, the lasers are not those of the sensor, or the
        unit of the times cannot be inferred.
    """
    columns, missing = without_missing(_READERS[path.suffix.lower()](path), "column")
    counts = tell_missing(str(path), missing)
    seconds = _seconds(path, columns, time_unit)
    table = returns_of_columns(columns, seconds, sensor or load_sensor("vlp16"), str(path))
    return replace(table, about={**table.about, "format": path.suffix[1:].lower(), **counts})


def returns_of_columns(
    columns: Columns, seconds: Floats, device: Sensor, label: str
) -> ReturnTable:
    """Convert the columns of points to a table of a sensor's returns.

    The laser of each point is taken from the first of the columns `laser_id`, `laser`, `label`,
    `ring`, `channel` and `line` that suits the sensor. A column suits if its values, read as
    numbers of lasers or as ranks by elevation, put the points on the cones that these lasers draw.
    Azimuths count clockwise from the y axis. Distances are computed from the horizontal range and
    the laser's nominal elevation. Reflectivities are -1 (unknown) unless all are numbers from 0 to
    255.

    Parameters
    ----------
    columns
        Values, (n,), by name: ``x``, ``y`` and ``z`` in the sensor's coordinates, in m; a laser
        column; optionally a reflectivity, and ``turn``, an integer that is kept.
    seconds
        Times of the points, (n,), in s.
    device
        The sensor.
    label
        Text with which warnings begin.

    Returns
    -------
    ReturnTable
        A row for each point.

    Raises
    ------
    InputError
        No laser column suits the sensor.
    """
    xyz = _points(columns, label)
    laser = _lasers(columns, xyz, device, label)
    azimuth = np.mod(np.arctan2(xyz[:, 0], xyz[:, 1]), 2 * np.pi)
    elevation = np.radians(device.laser_elevation_deg)[laser]
    values = {
        "timestamp": seconds,
        "laser_id": laser,
        "azimuth": azimuth,
        "elevation": elevation,
        "distance": np.hypot(xyz[:, 0], xyz[:, 1]) / np.cos(elevation),
        "reflectivity": _reflectivities(columns, label),
        **{axis: xyz[:, place] for place, axis in enumerate("xyz")},
    }
    if "turn" in columns and columns["turn"].dtype.kind in "iu":
        values["turn"] = columns["turn"]
    unknown = np.zeros(len(xyz))
    table = {
        name: values.get(name, unknown).astype(kind) for name, (kind, *_) in RETURN_COLUMNS.items()
    }
    rings = ranks_of_lasers(device.laser_elevation_deg).tolist()
    return ReturnTable(table, {"sensor": device.name, "rings": rings})


def _points(columns: Columns, label: str) -> Floats:
    xyz = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
    check_points(xyz, label)
    return xyz


def without_missing(columns: Columns, kind: str) -> tuple[Columns, int]:
    """Remove missing returns, which are points at the origin or whose coordinates are all nan.

    Parameters
    ----------
    columns
        Values, (n,), by name of the column.
    kind
        Word for a column in the error message, such as "field".

    Returns
    -------
    columns
        The columns without the missing returns.
    missing
        Number of missing returns.

    Raises
    ------
    InputError
        There is no column x, y or z.
    """
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"no {kind} {', '.join(missing)} of numbers")
    axes = [columns[axis] for axis in "xyz"]
    is_missing = np.all([np.isnan(axis) for axis in axes], axis=0)
    is_missing |= np.all([axis == 0 for axis in axes], axis=0)
    if not is_missing.any():
        return columns, 0
    return {name: part[~is_missing] for name, part in columns.items()}, int(is_missing.sum())


def tell_missing(label: str, count: int) -> dict[str, int]:
    """Warn of missing returns that were left out.

    Parameters
    ----------
    label
        Text with which the warning begins.
    count
        Number of missing returns; 0 gives no warning.

    Returns
    -------
    dict
        Entries with this number for the description of the cloud; empty if `count` is 0.
    """
    if not count:
        return {}
    _log.warning("%s: left out %s", label, counted(count, "missing return"))
    return {"dropped_points": count, "missing_returns": count}


def _lasers(columns: Columns, xyz: Floats, sensor: Sensor, label: str) -> NDArray[np.intp]:
    names = [name for name in LASERS if name in columns]
    if not names:
        raise InputError(f"no laser column ({', '.join(LASERS)})")
    ids, by_rank = np.arange(sensor.lasers), np.argsort(sensor.laser_elevation_deg)
    faults = []
    for name in names:
        for order in (by_rank, ids) if name in _RANKS else (ids, by_rank):
            try:
                lasers = order[_numbered(columns[name], sensor)]
                off_deg = _off_cones(xyz, lasers, sensor)
            except InputError as error:
                faults.append(f"column {name} {error}")
                continue
            share = float(np.mean(np.abs(off_deg) > MOST_OFF_DEG))
            if share > _MOST_OFF:
                told = f"{share:.0%} of the points lie more than {MOST_OFF_DEG:g} degrees off"
                _log.warning("%s: column %s: %s the cones of their lasers", label, name, told)
            return lasers
    raise InputError(faults[0])


def _numbered(column: NDArray[Any], sensor: Sensor) -> NDArray[np.intp]:
    values = np.asarray(column, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        is_laser = (values == np.floor(values)) & (values >= 0) & (values < sensor.lasers)
    if not is_laser.all():
        value = f"{values[np.argmin(is_laser)]:g}"
        last = sensor.lasers - 1
        raise InputError(
            f"has a value that is not a laser of the {sensor.name}: {value}, not 0 to {last}"
        )
    return values.astype(np.intp)


def _off_cones(xyz: Floats, lasers: NDArray[np.intp], sensor: Sensor) -> Floats:
    """Return the angle between each point and the cone of its laser, (n,), in degrees."""
    level, elevations = np.hypot(xyz[:, 0], xyz[:, 1]), np.asarray(sensor.laser_elevation_deg)
    corrections = np.asarray(sensor.vertical_correction_mm or np.zeros(sensor.lasers)) / 1000
    present, apart = np.unique(lasers), np.diff(np.unique(elevations))
    fits: list[tuple[tuple[float, int], Floats]] = []
    for height in (corrections, np.zeros(sensor.lasers)):
        off = np.degrees(np.arctan2(xyz[:, 2] - height[lasers], level)) - elevations[lasers]
        worst = max((float(np.median(np.abs(off[lasers == k]))), int(k)) for k in present)
        fits.append((worst, off))
    (degrees, laser), least = min(fits, key=lambda fit: fit[0])
    if degrees > MOST_OFF_DEG:
        raise InputError(
            f"has no lasers: points of laser {laser} lie {degrees:.1f} degrees off its cone; this"
            f" is not a recording of a {sensor.name} in its frame (another sensor: --sensor)"
        )
    shift = abs(float(np.median([np.median(least[lasers == k]) for k in present])))
    if len(apart) and shift > np.median(apart) / 2:
        raise InputError(
            f"has no lasers: points lie {shift:.2f} degrees off the cones of their lasers, "
            f"nearer to those of others (does it count the lasers of the {sensor.name} from 0?)"
        )
    return least


def _seconds(path: Path, columns: Columns, unit: TimeUnit | None) -> Floats:
    xyz = _points(columns, str(path))
    name = next((name for name in TIMES if name in columns), None)
    if name is None:
        return np.zeros(len(xyz))
    times, azimuth = columns[name], np.arctan2(xyz[:, 0], xyz[:, 1])
    check_finite(f"column {name}", times)
    inferred = unit or unit_of(times, azimuth)
    if inferred is None:
        raise InputError(
            f"column {name} has {_kind(times)} whose unit cannot be inferred: add --time-unit ns"
        )
    if fault := fault_of(times, inferred, azimuth if unit is None else None):
        _log.warning("%s: column %s %s: its times are left out", path, name, fault)
        return np.zeros(len(times))
    if unit is None and inferred != "s":
        _log.warning("%s: times in column %s: %s", path, name, inferred)
    if falls(times):
        _log.warning("%s: column %s has times that fall from point to point", path, name)
    seconds = seconds_of(times, inferred)
    if leap := largest_leap(seconds):
        _log.warning("%s: column %s leaps by %.6g s after %.6g s", path, name, *leap)
    return seconds


def _kind(values: NDArray[Any]) -> str:
    return "integers" if values.dtype.kind in "iu" else "numbers"


def _reflectivities(columns: Columns, label: str) -> NDArray[Any]:
    name = next((name for name in REFLECTIVITIES if name in columns), None)
    if name is None:
        return np.full(len(columns["x"]), UNKNOWN)
    values = columns[name].astype(np.float64)
    low, high = np.nanmin(values, initial=np.inf), np.nanmax(values, initial=-np.inf)
    is_share = high <= 1 and (values != np.floor(values)).any()
    if low >= 0 and high <= _BRIGHTEST and not is_share and not np.isnan(values).any():
        return np.rint(values)
    nan = " and nan" * bool(np.isnan(values).any())
    seen = f"{low:g} to {high:g}{nan}" if low <= high else "nan"
    fault = f"{seen}, which are no reflectivities from 0 to {_BRIGHTEST}"
    _log.warning("%s: column %s has %s: left out (-1)", label, name, fault)
    return np.full(len(values), UNKNOWN)


def check_finite(what: str, values: NDArray[Any]) -> None:
    """Raise InputError, with a message that begins with `what`, if a value is not finite."""
    if not np.isfinite(values).all():
        raise InputError(f"{what} has a value that is not finite")

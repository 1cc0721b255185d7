"""Clouds of another decoder (CSV, PLY, PCD) that tell each point's laser, as capture tables."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.geometry.cloud import Floats, check_points
from puckbench.lidar.recordings.capture_table import CAPTURE_COLUMNS, CaptureTable
from puckbench.lidar.sensor import Sensor, load_sensor

SUFFIXES = (".csv", ".ply", ".pcd")
_IDS = ("laser_id", "laser", "label")
# ROS drivers number the lasers from the lowest to the highest.
_RANKS = ("ring", "channel")
_TIMES = ("timestamp", "time")
_REFLECTIVITIES = ("reflectivity", "intensity")
# In one field of a PCD file (the largest of PCL's descriptors has 1,980).
_MOST_VALUES = 4096

Columns = Mapping[str, NDArray[Any]]


def read_points(path: Path, sensor: Sensor | None = None) -> CaptureTable:
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
        name: known.get(name, unknown).astype(kind) for name, (kind, *_) in CAPTURE_COLUMNS.items()
    }
    return CaptureTable(table, {"sensor": device.name, "format": path.suffix[1:].lower()})


def read_pcd(data: bytes) -> dict[str, NDArray[Any]]:
    """Columns of a PCD file (ASCII or binary) by the names of its fields."""
    head = re.match(rb"(?:[^\n]*\n){0,40}?DATA[ \t]+(\w+)[^\n]*\n", data)
    if head is None:
        raise InputError("not a PCD file")
    lines = [line.split() for line in head.group().decode("ascii", "replace").splitlines()]
    header = {line[0]: line[1:] for line in lines if line}
    try:
        kind = np.dtype(list(_pcd_fields(header)))
        points = int(header["POINTS"][0])
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise InputError("the header of the PCD file is damaged") from error
    body, form = data[head.end() :], head.group(1)
    if form == b"ascii":
        rows = _ascii_rows(body, kind)
    elif form == b"binary":
        rows = np.frombuffer(body[: len(body) // kind.itemsize * kind.itemsize], kind)
    else:
        raise InputError(f"a PCD file of the form {form.decode()}, where ascii or binary is read")
    if not 0 < points <= len(rows):
        raise InputError(f"the PCD file tells {points} points and has {len(rows)}")
    return {name: rows[name][:points] for name in kind.names or ()}


def _pcd_fields(header: dict[str, list[str]]) -> Any:
    letters = {"F": "f", "U": "u", "I": "i"}
    fields, sizes, types = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = header.get("COUNT", ["1"] * len(fields))
    for place, (name, size, letter, count) in enumerate(
        zip(fields, sizes, types, counts, strict=True)
    ):
        if not 1 <= int(count) <= _MOST_VALUES:
            raise ValueError(f"{count} values in a field")
        shape = () if int(count) == 1 else (int(count),)
        # PCL calls every gap "_".
        yield f"_{place}" if name == "_" else name, f"<{letters[letter]}{int(size)}", shape


def _ascii_rows(body: bytes, kind: np.dtype[Any]) -> NDArray[Any]:
    from io import StringIO

    try:
        rows = np.loadtxt(StringIO(body.decode("ascii")), dtype=kind, ndmin=1)
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"the PCD file has a damaged line ({error})") from error
    return np.asarray(rows)


def _read_pcd(path: Path) -> Columns:
    return read_pcd(read_bytes(path))


def _read_ply(path: Path) -> Columns:
    from plyfile import PlyData, PlyParseError

    read_bytes(path)
    try:
        vertices = PlyData.read(str(path))["vertex"].data
    except (PlyParseError, KeyError, ValueError, UnicodeDecodeError) as error:
        raise InputError(f"not a readable PLY file ({error})") from error
    return {name: vertices[name] for name in vertices.dtype.names or ()}


def _read_csv(path: Path) -> Columns:
    import pyarrow as pa
    from pyarrow import csv

    read_bytes(path)
    try:
        table = csv.read_csv(path)
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"not a readable CSV file ({' '.join(str(error).split())})") from error
    columns = {str(name).strip(): table.column(name) for name in table.column_names}
    numbers = {
        name: column.to_numpy()
        for name, column in columns.items()
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    }
    return {name.lower(): values for name, values in numbers.items()}


_READERS = {".csv": _read_csv, ".ply": _read_ply, ".pcd": _read_pcd}


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

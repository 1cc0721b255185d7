"""E57 (ASTM E2807), the format of terrestrial scanners, by pye57 where that is installed."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.io.isolated import Parsed, isolated
from puckbench.io.point_columns import Columns

_LOG = logging.getLogger(__name__)
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_STATES = ("cartesianInvalidState", "sphericalInvalidState")
_NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
_DAMAGE = (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError)
_LONGEST_FAULT, _LONGEST_LIST = 120, 120


def read_e57(path: Path) -> Columns:
    """Read the points of all scans of a file, each moved to its pose.

    Points that the scanner marks as invalid have no coordinates (NaN). Where there are several
    scans, the column ``scan`` has their number. A remark names fields that are left out.

    Raises
    ------
    InputError
        pye57 is not installed, or the file is missing or damaged.
    """
    return isolated(parse_e57, path, "E57 file").columns


def parse_e57(path: Path) -> Parsed:
    """As `read_e57`, in this process."""
    try:
        from pye57 import E57
        from pye57.libe57 import E57Exception
    except ImportError as error:
        how = "pip install 'puckbench[e57]'"
        raise InputError(f"{path}: reading E57 takes the package pye57 ({how})") from error
    try:
        with E57(str(path)) as file:
            others = _unreadable_fields(file)
            scans = [_scan(file, number) for number in range(file.scan_count)]
    except (E57Exception, *_DAMAGE) as error:
        fault = " ".join(str(error).partition("\n")[0].split())[:_LONGEST_FAULT]
        raise InputError(f"{path}: not a readable E57 file ({fault})") from error
    if not scans:
        raise InputError(f"{path}: the cloud is empty")
    columns = _joined(scans)
    others |= {name for scan in scans for name in scan if name not in columns}
    if others:
        names = ", ".join(sorted(others))[:_LONGEST_LIST]
        _LOG.warning("%s: fields of no numbers or not of all scans are left out: %s", path, names)
    return Parsed(columns)


def _joined(scans: list[Columns]) -> Columns:
    """The columns that all scans have, and the scan of each point if there are several."""
    shared = [name for name in scans[0] if all(name in scan for scan in scans)]
    columns = {name: np.concatenate([scan[name] for scan in scans]) for name in shared}
    if len(scans) > 1:
        columns["scan"] = np.repeat(np.arange(len(scans)), [len(scan["x"]) for scan in scans])
    return columns


def _fields(file: Any, number: int) -> dict[str, Any]:
    """The fields of a scan's points by name, with pye57's number of their kind."""
    from pye57.libe57 import StructureNode

    prototype = StructureNode(file.get_header(number).points.prototype())
    nodes = (prototype.get(place) for place in range(prototype.childCount()))
    return {node.elementName(): node.type() for node in nodes}


def _types() -> dict[Any, type]:
    """NumPy's type of each kind of field that is numbers."""
    from pye57.libe57 import NodeType

    floats = dict.fromkeys((NodeType.E57_FLOAT, NodeType.E57_SCALED_INTEGER), np.float64)
    return {**floats, NodeType.E57_INTEGER: np.int64}


def _unreadable_fields(file: Any) -> set[str]:
    types = _types()
    scans = (_fields(file, number) for number in range(file.scan_count))
    return {name for fields in scans for name, kind in fields.items() if kind not in types}


def _scan(file: Any, number: int) -> Columns:
    """The points of a scan at their pose, with NaN for coordinates of invalid ones."""
    columns = _values(file, number)
    points = _points(columns)
    rotation, translation = _pose(file.get_header(number))
    placed = dict(zip("xyz", (points @ rotation.T + translation).T, strict=True))
    normals = [columns.pop(name) for name in _NORMALS if name in columns]
    if len(normals) == 3:
        turned = np.column_stack(normals) @ rotation.T
        placed |= dict(zip(("nx", "ny", "nz"), turned.T, strict=True))
    return placed | columns


def _values(file: Any, number: int) -> Columns:
    """All fields of a scan that are numbers, read as doubles, which hold integers to 2**53."""
    from pye57.libe57 import SourceDestBuffer, VectorSourceDestBuffer

    vector, types = file.get_header(number).points, _types()
    fields = {name: kind for name, kind in _fields(file, number).items() if kind in types}
    count = vector.childCount()
    columns = {name: np.empty(count) for name in fields}
    buffers = VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(SourceDestBuffer(file.image_file, name, column, count, True, True))
    read = vector.reader(buffers).read() if count else 0
    if read != count:
        raise ValueError(f"{read} of {count} points")
    return {name: columns[name].astype(types[kind]) for name, kind in fields.items()}


def _points(columns: Columns) -> Floats:
    """Points (n, 3) of a scan, NaN where they are invalid; removes them from the columns."""
    taken = {name: columns.pop(name, None) for name in (*_CARTESIAN, *_SPHERICAL, *_STATES)}
    for names, state in zip((_CARTESIAN, _SPHERICAL), _STATES, strict=True):
        parts = [part for name in names if (part := taken[name]) is not None]
        if len(parts) == 3:
            points = np.column_stack(parts).astype(np.float64)
            if taken[state] is not None:
                points[taken[state] != 0] = np.nan
            return points if names == _CARTESIAN else _cartesian(points)
    raise ValueError("a scan without coordinates")


def _cartesian(coordinates: Floats) -> Floats:
    """Points (n, 3) of distances, azimuths and elevations (n, 3)."""
    distance, azimuth, elevation = coordinates.T
    flat = distance * np.cos(elevation)
    return np.column_stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)]
    )


def _pose(header: Any) -> tuple[Floats, Floats]:
    """Rotation (3, 3) and translation (3,) of a scan."""
    pose = header["pose"] if header.has_pose() else None
    w, *axis = _numbers(pose, "rotation", {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0})
    translation = np.array(_numbers(pose, "translation", {"x": 0.0, "y": 0.0, "z": 0.0}))
    square = w * w + float(np.dot(axis, axis))
    if not np.isfinite([square, *translation]).all() or square == 0:
        raise ValueError("a pose that is none")
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + 2 * (w * cross + cross @ cross) / square
    return rotation, translation


def _numbers(pose: Any, name: str, parts: Mapping[str, float]) -> Iterable[float]:
    """Parts of a pose by their names; those of the identity where the file has none."""
    if pose is None or not pose.isDefined(name):
        return list(parts.values())
    return [float(pose[name][part].value()) for part in parts]

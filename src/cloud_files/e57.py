"""Reader of E57 files (ASTM E2807) from terrestrial scanners, which needs the package pye57."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cloud_files.missing_returns import missing_returns
from pointkit.damage import PARSER_FAULTS, reading
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats
from pointkit.isolated import Columns, ParsedFile, parse_isolated

_LOG = logging.getLogger(__name__)
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_STATES = ("cartesianInvalidState", "sphericalInvalidState")
_NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
_COLOURS = ("colorRed", "colorGreen", "colorBlue")
_FIRINGS = ("rowIndex", "columnIndex", "sphericalRange")
"""Columns of scans in their scanner's frame, in which no return lies at the origin."""
_LIMITS = ("intensityMinimum", "intensityMaximum")
_MAX_LIST_LENGTH = 120


def read_e57(path: Path, keep_missing: bool = False) -> Columns:
    """Read the points of all scans of an E57 file, moved by the scans' poses into one frame.

    The file is parsed in a process of its own: it may announce any number of points, for which the
    package pye57 takes memory before it reads them.

    Parameters
    ----------
    path
        The file.
    keep_missing
        Whether to keep missing returns (points at the position of the scanner). By default, their
        coordinates are NaN, as are those of points that the file marks as invalid.

    Returns
    -------
    dict
        Columns (n,) by name: x, y and z in metres, nx, ny and nz if there are normals, and the
        numeric fields that all scans have. With several scans, ``scan`` is the number of the scan,
        from 0.

    Raises
    ------
    InputError
        pye57 is not installed, or the file is damaged or without points.
    """
    return parse_isolated(parse_e57, path, "E57 file", {"keep_missing": keep_missing}).columns


def parse_e57(path: Path, keep_missing: bool = False) -> ParsedFile:
    """Read an E57 file as `read_e57` does, but in the calling process."""
    try:
        from pye57 import E57
        from pye57.libe57 import E57Exception
    except ImportError as error:
        how = "pip install 'puckbench[e57]'"
        raise InputError(f"{path}: reading E57 takes the package pye57 ({how})") from error
    with naming(path), reading("E57 file", E57Exception, *PARSER_FAULTS), E57(str(path)) as file:
        omitted = _unreadable_fields(file)
        scans = [_scan(file, number, keep_missing) for number in range(file.scan_count)]
        has_other_limits = _have_other_limits(file)
    if not scans:
        raise InputError(f"{path}: the cloud is empty")
    columns = _concatenated(scans)
    omitted |= {name for scan in scans for name in scan if name not in columns}
    if omitted:
        names = ", ".join(sorted(omitted))[:_MAX_LIST_LENGTH]
        _LOG.warning("%s: fields of no numbers or not of all scans are left out: %s", path, names)
    if has_other_limits and "intensity" in columns:
        _LOG.warning("%s: scans have intensities of different limits, kept as they are", path)
    return ParsedFile(columns)


def _have_other_limits(file: Any) -> bool:
    headers = [file.get_header(number) for number in range(file.scan_count)]
    nodes = [
        header["intensityLimits"] for header in headers if "intensityLimits" in header.scan_fields
    ]
    limits = {
        tuple(float(node[name].value()) for name in _LIMITS if node.isDefined(name))
        for node in nodes
    }
    return len(limits) > 1


def _concatenated(scans: list[Columns]) -> Columns:
    _unite_colours(scans)
    shared = [name for name in scans[0] if all(name in scan for scan in scans)]
    columns = {name: np.concatenate([scan[name] for scan in scans]) for name in shared}
    if len(scans) > 1:
        columns["scan"] = np.repeat(np.arange(len(scans)), [len(scan["x"]) for scan in scans])
    return columns


def _unite_colours(scans: list[Columns]) -> None:
    """Scale the colours of all scans to the widest of their types: shares, bytes or 16 bits."""
    coloured = [scan for scan in scans if all(name in scan for name in _COLOURS)]
    whites = [_white(scan) for scan in coloured]
    for scan, white in zip(coloured, whites, strict=True):
        if white < max(whites):
            scan |= {name: scan[name] * (max(whites) // white) for name in _COLOURS}


def _white(scan: Columns) -> int:
    high = max(float(scan[name].max(initial=0)) for name in _COLOURS)
    is_share = high <= 1 and all(scan[name].dtype.kind == "f" for name in _COLOURS)
    return 1 if is_share else 0xFF if high <= 0xFF else 0xFFFF


def _fields(file: Any, number: int) -> dict[str, Any]:
    from pye57.libe57 import StructureNode

    prototype = StructureNode(file.get_header(number).points.prototype())
    nodes = (prototype.get(place) for place in range(prototype.childCount()))
    return {node.elementName(): node.type() for node in nodes}


def _numpy_types() -> dict[Any, type]:
    from pye57.libe57 import NodeType

    floats = dict.fromkeys((NodeType.E57_FLOAT, NodeType.E57_SCALED_INTEGER), np.float64)
    return {**floats, NodeType.E57_INTEGER: np.int64}


def _unreadable_fields(file: Any) -> set[str]:
    types = _numpy_types()
    scans = (_fields(file, number) for number in range(file.scan_count))
    return {name for fields in scans for name, kind in fields.items() if kind not in types}


def _scan(file: Any, number: int, keep_missing: bool) -> Columns:
    columns = _numeric_fields(file, number)
    has_firings = any(name in columns for name in _FIRINGS)
    points = _pop_points(columns)
    if not keep_missing:  # the pose would move them
        points[missing_returns(points, has_firings)] = np.nan
    rotation, translation = _pose(file.get_header(number))
    transformed = dict(zip("xyz", (points @ rotation.T + translation).T, strict=True))
    normals = [columns.pop(name) for name in _NORMALS if name in columns]
    if len(normals) == 3:
        rotated = np.column_stack(normals) @ rotation.T
        transformed |= dict(zip(("nx", "ny", "nz"), rotated.T, strict=True))
    return transformed | columns


def _numeric_fields(file: Any, number: int) -> Columns:
    from pye57.libe57 import SourceDestBuffer, VectorSourceDestBuffer

    vector, types = file.get_header(number).points, _numpy_types()
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


def _pop_points(columns: Columns) -> Floats:
    removed = {name: columns.pop(name, None) for name in (*_CARTESIAN, *_SPHERICAL, *_STATES)}
    for names, states in ((_CARTESIAN, _STATES), (_SPHERICAL, _STATES[::-1])):
        axes = [axis for name in names if (axis := removed[name]) is not None]
        if len(axes) == 3:
            points = np.column_stack(axes).astype(np.float64)
            known = [state for name in states if (state := removed[name]) is not None]
            if known:
                points[known[0] != 0] = np.nan
            return points if names == _CARTESIAN else _cartesian(points)
    raise ValueError("a scan without coordinates")


def _cartesian(coordinates: Floats) -> Floats:
    distance, azimuth, elevation = coordinates.T
    horizontal = distance * np.cos(elevation)
    x, y = horizontal * np.cos(azimuth), horizontal * np.sin(azimuth)
    return np.column_stack([x, y, distance * np.sin(elevation)])


def _pose(header: Any) -> tuple[Floats, Floats]:
    pose = header["pose"] if header.has_pose() else None
    w, *axis = _pose_values(pose, "rotation", {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0})
    translation = np.array(_pose_values(pose, "translation", {"x": 0.0, "y": 0.0, "z": 0.0}))
    square = w * w + float(np.dot(axis, axis))
    if not np.isfinite([square, *translation]).all() or square == 0:
        raise ValueError("an invalid pose")
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + 2 * (w * cross + cross @ cross) / square
    return rotation, translation


def _pose_values(pose: Any, name: str, defaults: Mapping[str, float]) -> Iterable[float]:
    if pose is None or not pose.isDefined(name):
        return list(defaults.values())
    return [float(pose[name][part].value()) for part in defaults]

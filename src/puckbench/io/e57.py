"""E57 (ASTM E2807), the format of terrestrial scanners, by pye57 where that is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.io.point_columns import Columns

_STATES = ("cartesianInvalidState", "sphericalInvalidState")
_XYZ = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")


def read_e57(path: Path) -> Columns:
    """Read the valid points of all scans of a file, each moved to its pose.

    Where there are several, the column ``scan`` has their number.

    Raises
    ------
    InputError
        pye57 is not installed, or the file is missing or damaged.
    """
    try:
        import pye57
        from pye57.libe57 import E57Exception
    except ImportError as error:
        how = "pip install 'puckbench[e57]'"
        raise InputError(f"{path}: reading E57 takes the package pye57 ({how})") from error
    read_bytes(path)
    try:
        file = pye57.E57(str(path))
        scans = [_scan(file, number) for number in range(file.scan_count)]
    except (E57Exception, ValueError, KeyError, RuntimeError, MemoryError) as error:
        fault = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable E57 file ({fault})") from error
    if not scans:
        raise InputError(f"{path}: the cloud is empty")
    shared = [name for name in scans[0] if all(name in scan for scan in scans)]
    columns = {name: np.concatenate([scan[name] for scan in scans]) for name in shared}
    if len(scans) > 1:
        numbers = [np.full(len(scan["x"]), number) for number, scan in enumerate(scans)]
        columns["scan"] = np.concatenate(numbers)
    return columns


def _scan(file: Any, number: int) -> Columns:
    header = file.get_header(number)
    raw = dict(file.read_scan_raw(number))
    valid = np.ones(len(next(iter(raw.values()))), dtype=bool)
    for name in _STATES:
        valid &= np.asarray(raw.pop(name, 0)) == 0
    columns = {name: np.asarray(values)[valid] for name, values in raw.items()}
    points = _points(columns)
    if header.has_pose():
        points = points @ np.asarray(header.rotation_matrix).T + np.asarray(header.translation)
    return {**dict(zip("xyz", points.T, strict=True)), **columns}


def _points(columns: Columns) -> Any:
    """Points (n, 3) of a scan, their columns removed from the others."""
    if all(name in columns for name in _XYZ):
        return np.column_stack([columns.pop(name) for name in _XYZ]).astype(np.float64)
    if not all(name in columns for name in _SPHERICAL):
        raise ValueError("a scan without coordinates")
    distance, azimuth, elevation = (columns.pop(name).astype(np.float64) for name in _SPHERICAL)
    flat = distance * np.cos(elevation)
    return np.column_stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)]
    )

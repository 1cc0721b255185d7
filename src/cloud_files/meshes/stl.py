"""STL files, binary and ASCII."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np

from cloud_files.meshes.polygons import Polygons, uniform_polygons
from pointkit.errors import InputError
from pointkit.files import read_bytes

_LOG = logging.getLogger(__name__)
_HEADER_BYTES = 84
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SOLID, _END_OF_SOLID = re.compile(rb"(?mi)^\s*solid\b"), re.compile(rb"(?i)\bendsolid\b")
_PARTS = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)|\b(endloop)\b", re.IGNORECASE)


def read_stl(path: Path) -> Polygons:
    """Read the faces of a binary or ASCII STL file.

    Each face has its own three or more vertices. A file is taken as ASCII if it begins with "solid"
    and has no zero byte. Additional bytes after the triangles of a binary file are ignored with a
    warning. Raises InputError if the file is truncated.
    """
    data = read_bytes(path)
    return _ascii(data, path) if _is_ascii(data) else _binary(data, path)


def _is_ascii(data: bytes) -> bool:
    # Binary files may begin with "solid" too, but have zero bytes.
    return data.lstrip()[:5].lower() == b"solid" and b"\0" not in data


def _ascii(data: bytes, path: Path) -> Polygons:
    starts, ends_of_solids = (len(pattern.findall(data)) for pattern in (_SOLID, _END_OF_SOLID))
    if not ends_of_solids or ends_of_solids < starts:
        raise InputError(f"{path}: truncated: the solid has no end")
    parts = _PARTS.findall(data)
    ends = np.flatnonzero([bool(part[3]) for part in parts])
    if len(parts) != (ends[-1] + 1 if len(ends) else 0):
        raise InputError(f"{path}: a vertex lies outside of the loops")
    try:
        numbers = [float(number) for part in parts if not part[3] for number in part[:3]]
    except ValueError as error:
        raise InputError(f"{path}: a vertex is not three numbers") from error
    corners = np.array(numbers, dtype=np.float64).reshape(-1, 3)
    return Polygons(corners, np.arange(len(corners)), np.diff(ends, prepend=-1) - 1)


def _binary(data: bytes, path: Path) -> Polygons:
    if len(data) < _HEADER_BYTES:
        raise InputError(f"{path}: too short for an STL file ({len(data)} bytes)")
    count = int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    present, remainder = divmod(len(data) - _HEADER_BYTES, _RECORD.itemsize)
    if present < count:
        raise InputError(f"{path}: truncated or not STL: {present} of {count} triangles")
    if present > count:
        surplus = (present - count) * _RECORD.itemsize + remainder
        _LOG.warning("%s: left out %d bytes after its %d triangles", path, surplus, count)
    records = np.frombuffer(data, dtype=_RECORD, count=count, offset=_HEADER_BYTES)
    corners = records["corners"].reshape(-1, 3).astype(np.float64)
    return uniform_polygons(corners, np.arange(len(corners)).reshape(-1, 3))

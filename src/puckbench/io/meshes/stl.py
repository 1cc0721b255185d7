"""Reading STL meshes, binary and ASCII."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.geometry.cloud import Floats
from puckbench.io.meshes.polygons import Polygons, uniform

_HEADER_BYTES = 84
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(path: Path) -> Polygons:
    """Read an STL file; every triangle keeps three vertices of its own, as in the file."""
    data = read_bytes(path)
    corners = _ascii(data, path) if _is_ascii(data) else _binary(data, path)
    return uniform(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))


def _is_ascii(data: bytes) -> bool:
    # Binary files may begin with "solid" too; their length then fits their triangle count.
    said = int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    fits = len(data) == _HEADER_BYTES + said * _RECORD.itemsize
    return data.lstrip()[:5].lower() == b"solid" and not fits


def _ascii(data: bytes, path: Path) -> Floats:
    if b"endsolid" not in data.lower():
        raise InputError(f"{path}: truncated: the solid has no end")
    try:
        return np.array(_VERTEX.findall(data)).astype(np.float64).reshape(-1, 3)
    except ValueError as error:
        raise InputError(f"{path}: a vertex is not three numbers") from error


def _binary(data: bytes, path: Path) -> Floats:
    if len(data) < _HEADER_BYTES:
        raise InputError(f"{path}: too short for an STL file ({len(data)} bytes)")
    said = int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    there = (len(data) - _HEADER_BYTES) // _RECORD.itemsize
    if there < said:
        raise InputError(f"{path}: truncated or not STL: {there} of {said} triangles are there")
    records = np.frombuffer(data, dtype=_RECORD, count=said, offset=_HEADER_BYTES)
    return records["corners"].reshape(-1, 3).astype(np.float64)

"""OFF files (Object File Format)."""

from __future__ import annotations

import codecs
import logging
import re
from pathlib import Path

import numpy as np

from cloud_files.meshes.polygons import Polygons
from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats, Ints

# OFF, COFF, NOFF, STOFF and their mixtures put the position first; 4OFF and nOFF do not.
_HEADER = re.compile(rb"(?:ST)?C?N?OFF(?![A-Za-z])", re.IGNORECASE)
_log = logging.getLogger(__name__)


def read_off(path: Path) -> Polygons:
    """Read the vertices and faces of an ASCII OFF file, without colours and normals.

    The header line ``OFF`` may be missing, or may be joined to the counts, as in the data set
    ModelNet40. Additional lines at the end are ignored with a warning. Raises InputError if a line
    is invalid, or if there are fewer lines than the counts say.
    """
    counts, rows = _counts_and_rows(read_bytes(path), path)
    vertices, faces = counts
    if len(rows) < vertices + faces:
        fault = f"{len(rows)} lines for {vertices} vertices and {faces} faces"
        raise InputError(f"{path}: truncated: {fault}")
    if surplus := len(rows) - vertices - faces:
        _log.warning("%s: left out %d lines after its %d faces", path, surplus, faces)
    corners, sizes = _faces(rows[vertices : vertices + faces], path)
    return Polygons(_vertices(rows[:vertices], path), corners, sizes)


def _counts_and_rows(data: bytes, path: Path) -> tuple[tuple[int, int], list[bytes]]:
    lines = data.removeprefix(codecs.BOM_UTF8).splitlines()
    rows = list(filter(None, (line.partition(b"#")[0].strip() for line in lines)))
    if rows and (header := _HEADER.match(rows[0])):
        counts = rows[0][header.end() :].strip()
        rows = [counts, *rows[1:]] if counts else rows[1:]
    try:
        vertices, faces = (int(count) for count in rows[0].split()[:2])
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: not a readable OFF file (no counts at its start)") from error
    if vertices < 0 or faces < 0:
        raise InputError(f"{path}: the counts of the OFF file are negative")
    return (vertices, faces), rows[1:]


def _vertices(rows: list[bytes], path: Path) -> Floats:
    try:
        numbers = [float(number) for row in rows for number in row.split(None, 3)[:3]]
        return np.array(numbers, dtype=np.float64).reshape(len(rows), 3)
    except ValueError as error:
        raise InputError(f"{path}: a vertex is not three numbers") from error


def _faces(rows: list[bytes], path: Path) -> tuple[Ints, Ints]:
    corners: list[int] = []
    sizes = np.empty(len(rows), dtype=np.int64)
    for index, row in enumerate(rows):
        tokens = row.split()
        try:
            size = int(tokens[0])
            corners += map(int, tokens[1 : size + 1])
        except ValueError as error:
            raise InputError(f"{path}: face {index} is not made of integers") from error
        if not 0 <= size < len(tokens):
            raise InputError(f"{path}: face {index} has fewer corners than it says")
        sizes[index] = size
    try:
        return np.array(corners, dtype=np.int64), sizes
    except OverflowError as error:
        raise InputError(f"{path}: a face refers to a vertex that does not exist") from error

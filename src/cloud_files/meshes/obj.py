"""Wavefront OBJ files."""

from __future__ import annotations

import codecs
from collections import Counter
from itertools import accumulate
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cloud_files.meshes.polygons import Polygons
from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats, Ints

_SKIPPED = {
    b"l": "polylines",
    b"p": "point_elements",
    b"curv": "curves",
    b"curv2": "curves",
    b"surf": "free_form_surfaces",
}


def read_obj(path: Path) -> Polygons:
    """Read the vertices, faces and names of materials from a Wavefront OBJ file.

    Vertices and faces keep their order. Polylines, points, curves and surfaces are left out, and
    their numbers are returned in ``skipped``. Other files that an OBJ file names, such as materials
    (.mtl), are not opened. Raises InputError if a vertex or a face does not consist of numbers, or
    if vertices have weights.
    """
    return parse_obj(read_bytes(path), str(path))


def parse_obj(data: bytes, source: str) -> Polygons:
    """Return the polygons in the content of an OBJ file, as `read_obj` does.

    Parameters
    ----------
    data
        Content of the file.
    source
        Name of the file for messages.
    """
    lines = _lines(data)
    kinds = [line.partition(b" ")[0] for line in lines]
    faces = [
        line[1:].partition(b"#")[0] for line, kind in zip(lines, kinds, strict=True) if kind == b"f"
    ]
    points = [line[1:] for line, kind in zip(lines, kinds, strict=True) if kind == b"v"]
    materials, material_id = _materials(lines, kinds) if b"usemtl" in data else ((), None)
    del lines
    sizes = np.fromiter((len(face.split()) for face in faces), dtype=np.int64, count=len(faces))
    corners = _corners(faces, source)
    if len(corners) and corners.min() < 0:
        corners = _absolute(corners, sizes, kinds)
    skipped = dict(Counter(_SKIPPED[kind] for kind in kinds if kind in _SKIPPED))
    vertices = _vertices(points, source)
    return Polygons(vertices, corners - 1, sizes, None, None, skipped, materials, material_id)


def _lines(data: bytes) -> list[bytes]:
    data = data.removeprefix(codecs.BOM_UTF8)
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    return [line.strip() for line in data.replace(b"\t", b" ").splitlines()]


def _vertices(lines: list[bytes], source: str) -> Floats:
    try:
        if lines and len(lines[0].split()) == 4:
            _check_weights(lines, source)
        numbers = [float(number) for line in lines for number in line.split(None, 3)[:3]]
        return np.array(numbers, dtype=np.float64).reshape(len(lines), 3)
    except ValueError as error:
        invalid = next((line for line in lines if not _is_vertex(line)), b"")
        raise InputError(f"{source}: not a vertex: {_quoted(invalid)}") from error


def _check_weights(lines: list[bytes], source: str) -> None:
    for line in lines:
        words = line.split()
        if len(words) == 4 and float(words[3]) != 1:
            raise InputError(f"{source}: not a vertex in space, but with a weight: {_quoted(line)}")


def _corners(lines: list[bytes], source: str) -> Ints:
    # One flat list: a list per line takes longer than the parsing.
    tokens = b" ".join(lines).split()
    try:
        return np.array([int(token.partition(b"/")[0]) for token in tokens], dtype=np.int64)
    except (ValueError, OverflowError) as error:
        invalid = next((line for line in lines if not all(map(_is_corner, line.split()))), b"")
        raise InputError(f"{source}: not a face: {_quoted(invalid)}") from error


def _materials(lines: list[bytes], kinds: list[bytes]) -> tuple[tuple[str, ...], Ints]:
    changes = [row for row, kind in enumerate(kinds) if kind == b"usemtl"]
    numbers: dict[bytes, int] = {}
    ids = [numbers.setdefault(lines[row][6:].strip(), len(numbers)) for row in changes]
    faces = np.flatnonzero(np.fromiter((kind == b"f" for kind in kinds), dtype=np.bool_))
    material_id = np.array([-1, *ids], dtype=np.int64)[np.searchsorted(changes, faces)]
    return tuple(name.decode("utf-8", "replace") for name in numbers), material_id


def _absolute(corners: Ints, sizes: Ints, kinds: list[bytes]) -> Ints:
    """Replace negative indices, which count back from the last vertex before the face."""
    vertex_counts = np.fromiter(accumulate(kind == b"v" for kind in kinds), dtype=np.int64)
    is_face = np.fromiter((kind == b"f" for kind in kinds), dtype=np.bool_)
    vertices_before: NDArray[np.int64] = np.repeat(vertex_counts[is_face], sizes)
    return np.where(corners < 0, vertices_before + corners + 1, corners)


def _is_vertex(line: bytes) -> bool:
    try:
        return len([float(number) for number in line.split()[:3]]) == 3
    except ValueError:
        return False


def _is_corner(token: bytes) -> bool:
    number = token.partition(b"/")[0].removeprefix(b"-")
    return number.isdigit() and len(number) < 19


def _quoted(line: bytes) -> str:
    return repr(line.strip()[:60].decode("ascii", "replace"))

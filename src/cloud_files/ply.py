"""PLY files, read and written by the package plyfile after a check of their sizes."""

from __future__ import annotations

import logging
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.content import plain_name, read_content
from cloud_files.point_columns import ascii_name, decoded
from pointkit.damage import reading
from pointkit.errors import InputError, naming
from pointkit.files import unreadable, written_whole

_MAX_HEADER_BYTES = 1 << 20
_OLD_TYPES = {"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4}
_TYPES = {f"{kind}{8 * size}": size for kind in ("int", "uint", "float") for size in (1, 2, 4, 8)}
_TYPE_BYTES = {**_OLD_TYPES, "double": 8, **_TYPES}
_DAMAGE = (KeyError, ValueError, OverflowError, MemoryError)
_log = logging.getLogger(__name__)
CORNER_LISTS = ("vertex_indices", "vertex_index")
"""Names of the property with a face's vertex indices."""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    min_bytes: int
    has_lists: bool


@dataclass(frozen=True)
class _PlyHeader:
    """Header of a PLY file.

    Its length is `size` bytes, and `lines` are its lines without comments. `is_plain` says that
    plyfile can read the header, and `is_text` that the data are ASCII.
    """

    size: int
    lines: bytes
    is_plain: bool
    is_text: bool
    elements: tuple[_Element, ...]


def read_elements(path: Path) -> Any:
    """Read a PLY file of any kind, text or binary, which may be compressed.

    Data after the last element are ignored with a warning.

    Returns
    -------
    PlyData
        The elements, as plyfile returns them: ``elements["vertex"].data`` has one row for each
        vertex with its properties.

    Raises
    ------
    InputError
        The file is damaged, or shorter than its header says.
    """
    head = read_content(path, _MAX_HEADER_BYTES)
    header = _header(head, path)
    if plain_name(path) == path and header.is_plain:
        _check_size(header, path.stat().st_size, path)
        if header.is_text:
            _warn_of_lines(header, _text(read_content(path)[header.size :]), path)
        return _parse(path, path)
    data = read_content(path)
    _check_size(header, len(data), path)
    body = data[header.size :]
    if header.is_text:
        body = _text(body)
        _warn_of_lines(header, body, path)
    # Some systems do not remove the file while the rows are memory-mapped to it.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        plain = Path(folder, path.name)
        plain.write_bytes(header.lines + body)
        return _parse(plain, path)


def _parse(source: Path, path: Path) -> Any:
    from plyfile import PlyData, PlyParseError

    try:
        # NumPy warns of empty lists in text.
        with (
            naming(path),
            reading("PLY file", PlyParseError, *_DAMAGE),
            warnings.catch_warnings(action="ignore"),
        ):
            for size in (3, 4):  # only uniform faces are memory-mapped
                corners = {"face": dict.fromkeys(CORNER_LISTS, size)}
                with suppress(PlyParseError):
                    return PlyData.read(str(source), known_list_len=corners)
            return PlyData.read(str(source))
    except OSError as error:
        raise unreadable(path, error) from error


def _header(head: bytes, path: Path) -> _PlyHeader:
    begin = re.match(rb"ply[ \t]*(\r\n|\n|\r)", head)
    ending = begin[1] if begin else b"\n"
    blanks = rb"[ \t\r]*" if ending == b"\n" else rb"[ \t]*"
    end = re.search(rb"(?<=[\r\n])end_header" + blanks + rb"(?:%b|\Z)" % ending, head)
    if begin is None or end is None:
        raise InputError(f"{path}: not a readable PLY file (no header)")
    lines = [line.split() for line in head[: end.end()].splitlines()]
    lines = [words for words in lines if words and words[0] not in (b"comment", b"obj_info")]
    is_text = [b"format", b"ascii"] in [words[:2] for words in lines]
    with naming(path), reading("PLY header", IndexError, KeyError, ValueError):
        elements = tuple(_elements(lines, is_text))
    plain = b"".join(b" ".join(map(_plain_word, words)) + b"\n" for words in lines)
    has_no_blanks = (begin[0], end[0]) == (b"ply" + ending, b"end_header" + ending)
    is_plain = has_no_blanks and head[: end.end()].isascii()
    return _PlyHeader(end.end(), plain, is_plain, is_text, elements)


def _plain_word(word: bytes) -> bytes:
    return word if word.isascii() else ascii_name(decoded(word)).encode()


def _elements(lines: list[list[bytes]], is_text: bool) -> Iterator[_Element]:
    places = [place for place, words in enumerate(lines) if words[0] == b"element"]
    for start, end in pairwise([*places, len(lines)]):
        kinds = [words[1:-1] for words in lines[start:end] if words[0] == b"property"]
        types = [kind[kind[0] == b"list"].decode() for kind in kinds]
        min_bytes = sum(2 if is_text else _TYPE_BYTES[name] for name in types)
        count = int(lines[start][2])
        if count < 0 or (count and not min_bytes):
            raise ValueError(f"{count} elements of {min_bytes} bytes")
        has_lists = any(kind[0] == b"list" for kind in kinds)
        yield _Element(lines[start][1].decode("ascii", "replace"), count, min_bytes, has_lists)


def _check_size(header: _PlyHeader, size: int, path: Path) -> None:
    min_bytes = sum(element.count * element.min_bytes for element in header.elements)
    if header.size + min_bytes > size + header.is_text:
        counts = ", ".join(f"{element.count} of {element.name}" for element in header.elements)
        raise InputError(f"{path}: not a readable PLY file (truncated: its header says {counts})")

    last = header.elements[-1] if header.elements else None
    surplus = size - header.size - min_bytes
    is_fixed = not header.is_text and not any(element.has_lists for element in header.elements)
    if last is not None and is_fixed and surplus >= last.min_bytes:
        _log.warning("%s: left out %d bytes after its %d %s", path, surplus, last.count, last.name)


def _text(body: bytes) -> bytes:
    return body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _warn_of_lines(header: _PlyHeader, body: bytes, path: Path) -> None:
    expected = sum(element.count for element in header.elements)
    surplus = body.rstrip().count(b"\n") + 1 - expected
    if body.strip() and surplus > 0:
        _log.warning("%s: left out %d lines after its %d lines", path, surplus, expected)


def has_faces(path: Path) -> bool:
    """Return whether a file is a PLY file that has faces and is thus a mesh."""
    try:
        elements = _header(read_content(path, _MAX_HEADER_BYTES), path).elements
    except InputError:
        return False
    return any(element.name == "face" and element.count for element in elements)


def read_ply(path: Path) -> dict[str, NDArray[Any]]:
    """Read the vertices of a PLY file.

    Properties that are lists are left out, with a warning.

    Returns
    -------
    dict
        One array (n,) for each property, by the name of the property.

    Raises
    ------
    InputError
        The file is damaged or has no vertices.
    """
    elements = read_elements(path)
    if "vertex" not in elements:
        raise InputError(f"{path}: not a readable PLY file (no vertices)")
    rows = np.asarray(elements["vertex"].data)
    names = rows.dtype.names or ()
    lists = [name for name in names if rows.dtype[name].hasobject]
    if lists:
        _log.warning("%s: lists of vertices are left out: %s", path, ", ".join(lists))
    return {name: rows[name] for name in names if name not in lists}


def write_ply(path: str | Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write a binary PLY file of vertices, with one property for each column.

    The file appears only when it is complete.

    Parameters
    ----------
    path
        The file to write.
    columns
        Arrays (n,) by name: integers and floating-point numbers of at most 32 bits, and float64.
    """
    with written_whole(path) as temporary:
        write_vertices(temporary, columns)


def write_vertices(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write a PLY file of vertices as `write_ply` does, but directly to `path`."""
    from plyfile import PlyData, PlyElement

    kinds = [(name, part.dtype) for name, part in columns.items()]
    rows = np.empty(len(next(iter(columns.values()))), dtype=kinds)
    for name, part in columns.items():
        rows[name] = part
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(path))

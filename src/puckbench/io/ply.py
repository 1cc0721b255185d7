"""PLY files (ASCII or binary): the elements of meshes and clouds, and columns of points."""

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

from puckbench.core.content import plain_name, read_content
from puckbench.core.errors import InputError
from puckbench.core.files import unreadable, written_whole

_LONGEST_HEADER = 1 << 20
_KINDS = {"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4}
_BITS = {f"{kind}{8 * size}": size for kind in ("int", "uint", "float") for size in (1, 2, 4, 8)}
_SIZES = {**_KINDS, "double": 8, **_BITS}
"""Bytes of the types of properties."""
_log = logging.getLogger(__name__)
CORNERS = ("vertex_indices", "vertex_index")
"""Names that programs give to the list of a face's vertices."""


@dataclass(frozen=True)
class _Element:
    """An element of a header: its name, how many there are, and the least bytes of each."""

    name: str
    count: int
    least_bytes: int


@dataclass(frozen=True)
class _Header:
    """A header: its bytes, its lines without comments, whether the body is text, elements.

    is_plain: whether plyfile takes it as it is.
    """

    size: int
    lines: bytes
    is_plain: bool
    is_text: bool
    elements: tuple[_Element, ...]


def read_elements(path: Path) -> Any:
    """Read the elements of a PLY file, by name and each with its rows as ``data``.

    Raises
    ------
    InputError
        The file is missing or damaged.
    """
    head = read_content(path, _LONGEST_HEADER)
    header = _header(head, path)
    if plain_name(path) == path and header.is_plain:
        _check_size(header, path.stat().st_size, path)
        return _elements(path, path)
    data = read_content(path)
    _check_size(header, len(data), path)
    body = data[header.size :]
    if header.is_text:
        body = body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    # The rows may be mapped to the file: some systems do not remove it before they are gone.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        plain = Path(folder, path.name)
        plain.write_bytes(header.lines + body)
        return _elements(plain, path)


def _elements(source: Path, path: Path) -> Any:
    """The elements of a plain file; errors name the path."""
    from plyfile import PlyData, PlyParseError

    try:
        with warnings.catch_warnings(action="ignore"):  # of NumPy, for empty lists as text
            # The mapped reading of files with triangles or quads alone is tried first: it is fast.
            for size in (3, 4):
                corners = {"face": dict.fromkeys(CORNERS, size)}
                with suppress(PlyParseError):
                    return PlyData.read(str(source), known_list_len=corners)
            return PlyData.read(str(source))
    except OSError as error:
        raise unreadable(path, error) from error
    except (PlyParseError, KeyError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(f"{path}: not a readable PLY file ({error})") from error


def _header(head: bytes, path: Path) -> _Header:
    """The header of a file, in whatever way its lines end, without comments."""
    begin = re.match(rb"ply[ \t]*(\r\n|\n|\r)", head)
    ending = begin[1] if begin else b"\n"
    blanks = rb"[ \t\r]*" if ending == b"\n" else rb"[ \t]*"
    end = re.search(rb"(?<=[\r\n])end_header" + blanks + rb"(?:%b|\Z)" % ending, head)
    if begin is None or end is None:
        raise InputError(f"{path}: not a readable PLY file (no header)")
    lines = [line.split() for line in head[: end.end()].splitlines()]
    lines = [words for words in lines if words and words[0] not in (b"comment", b"obj_info")]
    is_text = [b"format", b"ascii"] in [words[:2] for words in lines]
    try:
        elements = tuple(_counted(lines, is_text))
    except (IndexError, KeyError, ValueError) as error:
        raise InputError(f"{path}: not a readable PLY file (damaged header: {error})") from error
    plain = b"".join(b" ".join(words) + b"\n" for words in lines)
    has_no_blanks = (begin[0], end[0]) == (b"ply" + ending, b"end_header" + ending)
    is_plain = has_no_blanks and head[: end.end()].isascii()
    return _Header(end.end(), plain, is_plain, is_text, elements)


def _counted(lines: list[list[bytes]], is_text: bool) -> Iterator[_Element]:
    """The elements of a header's lines, split into words."""
    places = [place for place, words in enumerate(lines) if words[0] == b"element"]
    for start, end in pairwise([*places, len(lines)]):
        kinds = [words[1:-1] for words in lines[start:end] if words[0] == b"property"]
        least = sum(2 if is_text else _SIZES[kind[kind[0] == b"list"].decode()] for kind in kinds)
        count = int(lines[start][2])
        if count < 0 or (count and not least):
            raise ValueError(f"{count} elements of {least} bytes")
        yield _Element(lines[start][1].decode("ascii", "replace"), count, least)


def _check_size(header: _Header, size: int, path: Path) -> None:
    """InputError where a file has not as many bytes as its elements have at least."""
    least = sum(element.count * element.least_bytes for element in header.elements)
    if header.size + least > size + header.is_text:
        named = ", ".join(f"{element.count} of {element.name}" for element in header.elements)
        raise InputError(f"{path}: not a readable PLY file (truncated: its header says {named})")


def has_faces(path: Path) -> bool:
    """Whether the header of a PLY file announces faces; False where there is no such header."""
    try:
        elements = _header(read_content(path, _LONGEST_HEADER), path).elements
    except InputError:
        return False
    return any(element.name == "face" and element.count for element in elements)


def read_ply(path: Path) -> dict[str, NDArray[Any]]:
    """Read the properties of the vertices of a PLY file, (n,) each, by name, without lists."""
    elements = read_elements(path)
    if "vertex" not in elements:
        raise InputError(f"{path}: not a readable PLY file (no vertices)")
    rows = np.asarray(elements["vertex"].data)
    names = rows.dtype.names or ()
    lists = [name for name in names if rows.dtype[name].hasobject]
    if lists:
        _log.warning("%s: lists of vertices are left out: %s", path, ", ".join(lists))
    return {name: rows[name] for name in names if name not in lists}


def write_ply(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns (n,) as a binary little-endian PLY with one property of the vertices each."""
    with written_whole(path) as temporary:
        write_vertices(temporary, columns)


def write_vertices(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Like `write_ply`, to a file that its caller makes appear whole."""
    from plyfile import PlyData, PlyElement

    kinds = [(name, part.dtype) for name, part in columns.items()]
    rows = np.empty(len(next(iter(columns.values()))), dtype=kinds)
    for name, part in columns.items():
        rows[name] = part
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(path))

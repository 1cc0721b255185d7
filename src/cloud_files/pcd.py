"""PCD files of the Point Cloud Library.

They are not read by pypcd4, which accepts truncated files, and takes all memory for some damaged
headers.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.content import read_content
from cloud_files.point_columns import decoded
from pointkit.damage import one_line, reading
from pointkit.errors import InputError, naming
from pointkit.files import write_bytes

_MAX_VALUES = 4096
"""Maximum values of a field per point; PCL's largest descriptor has 1,980."""
_MAX_HEADER_BYTES = 1 << 16
_MAX_COMPRESSION = 100
"""Limit of the compression ratio; LZF compresses 264 bytes to three at best."""
_PAGE = 4096
"""Bytes of a page of memory. PCL writes binary files as if the header filled one."""
_log = logging.getLogger(__name__)
_HEADER_DAMAGE = (KeyError, IndexError, ValueError, TypeError, OverflowError)
_GAP = re.compile(r"_\d+")
_HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {fields}
SIZE {sizes}
TYPE {types}
COUNT {counts}
WIDTH {points}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {points}
DATA binary
"""


def write_pcd(path: str | Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write a binary PCD file with one field for each column.

    Parameters
    ----------
    path
        The file to write.
    columns
        Arrays (n,) of numbers by name. x, y and z are written as float32, as other programs expect;
        other columns keep their type.
    """
    parts = {name: part.astype("<f4") if name in "xyz" else part for name, part in columns.items()}
    kinds = [part.dtype.newbyteorder("<") for part in parts.values()]
    rows = np.empty(len(parts["x"]), dtype=[*zip(parts, kinds, strict=True)])
    for name, part in parts.items():
        rows[name] = part
    header = _HEADER.format(
        fields=" ".join(parts),
        sizes=" ".join(str(kind.itemsize) for kind in kinds),
        types=" ".join(kind.kind.upper() for kind in kinds),
        counts=" ".join("1" for _ in kinds),
        points=len(rows),
    )
    write_bytes(path, header.encode() + rows.tobytes())


def read_pcd(path: Path) -> dict[str, NDArray[Any]]:
    """Read the fields of an ascii, binary or compressed PCD file.

    Returns
    -------
    dict
        Arrays by name: (n,), or (n, values per point) for fields of several values.

    Raises
    ------
    InputError
        The file is damaged or has fewer points than its header says.
    """
    with naming(path):
        return parse_pcd(read_content(path), str(path))


def is_organised(path: Path) -> bool:
    """Return whether a PCD file is a range image: its header has a height of several rows."""
    height = re.search(rb"(?m)^HEIGHT[ \t]+(\d+)", read_content(path, _MAX_HEADER_BYTES))
    return height is not None and int(height[1]) > 1


def parse_pcd(data: bytes, source: str = "PCD file") -> dict[str, NDArray[Any]]:
    """Return the fields of a PCD file's content as `read_pcd` does.

    `source` names the file in warnings; messages of errors do not name it.
    """
    head = re.match(rb"(?:[^\n]*\n){0,40}?DATA[ \t]+(\w+)[^\n]*\n", data[:_MAX_HEADER_BYTES])
    if head is None:
        raise InputError("not a PCD file")
    lines = [decoded(line).split() for line in head.group().splitlines()]
    header = {line[0]: line[1:] for line in lines if line}
    with reading("PCD header", *_HEADER_DAMAGE):
        kind = np.dtype(list(_fields(header)))
        pixels = int(header["WIDTH"][0]) * int(header["HEIGHT"][0]) if "HEIGHT" in header else None
        points = int(header["POINTS"][0]) if "POINTS" in header else pixels or 0
    if kind.itemsize == 0:
        raise InputError("the PCD file has no fields")
    rows = _rows(data[head.end() :], head.group(1).decode(), kind, points)
    if not 0 < points <= len(rows):
        raise InputError(f"the PCD file has {len(rows)} points, but its header says {points}")
    counts = {"WIDTH x HEIGHT": pixels or points, "the data": len(rows)}
    others = [f"{count} in {place}" for place, count in counts.items() if count != points]
    if others:
        text = ", ".join(others)
        _log.warning("%s: POINTS says %d (%s): the first %d are read", source, points, text, points)
    return {name: rows[name][:points] for name in kind.names or () if not _GAP.fullmatch(name)}


def _fields(header: dict[str, list[str]]) -> Iterator[Any]:
    letters = {"F": "f", "U": "u", "I": "i"}
    fields, sizes, types = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = header.get("COUNT", ["1"] * len(fields))
    for place, (name, size, letter, count) in enumerate(
        zip(fields, sizes, types, counts, strict=True)
    ):
        if not 0 <= int(count) <= _MAX_VALUES:
            raise ValueError(f"{count} values in a field")
        if int(count) == 0:
            continue
        shape = () if int(count) == 1 else (int(count),)
        # PCL names every gap between fields "_".
        yield f"_{place}" if name == "_" else name, f"<{letters[letter]}{int(size)}", shape


def _rows(body: bytes, form: str, kind: np.dtype[Any], points: int) -> NDArray[Any]:
    if form == "ascii":
        return _ascii_rows(body, kind)
    if form == "binary":
        held = _without_padding(body, points * kind.itemsize)
        return np.frombuffer(held[: len(held) // kind.itemsize * kind.itemsize], kind)
    if form == "binary_compressed":
        return _compressed_rows(body, kind, points)
    raise InputError(f"PCD data of the form {form}, not ascii, binary or binary_compressed")


def _without_padding(body: bytes, size: int) -> bytes:
    """Return the data without zeros after it, with which PCL fills up the header's page."""
    is_padded = 0 < size < len(body) < size + _PAGE and not any(body[size:])
    return body[:size] if is_padded else body


def _ascii_rows(body: bytes, kind: np.dtype[Any]) -> NDArray[Any]:
    try:
        return np.asarray(np.loadtxt(StringIO(body.decode("ascii")), dtype=kind, ndmin=1))
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"the PCD file has a damaged line ({one_line(error)})") from error


def _compressed_rows(body: bytes, kind: np.dtype[Any], points: int) -> NDArray[Any]:
    import lzf

    packed, size = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
    if size != points * kind.itemsize or not size <= _MAX_COMPRESSION * len(body):
        raise InputError(f"the PCD file has {size} bytes for {points} points")
    try:
        plain = lzf.decompress(body[8 : 8 + packed], size)
    except ValueError as error:
        raise InputError("the PCD file has damaged compressed points") from error
    if plain is None or len(plain) != size:
        raise InputError("the PCD file has damaged compressed points")
    rows, start = np.empty(points, dtype=kind), 0
    for name in kind.names or ():
        part = np.frombuffer(plain, kind[name], points, start)
        rows[name], start = part, start + part.nbytes
    return rows

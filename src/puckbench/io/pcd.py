"""PCD files of the Point Cloud Library: ASCII, binary and compressed ones are read, binary written.

The header is read here and not by pypcd4, which takes truncated files for whole ones and runs out
of memory on a header that claims a hundred million values in a field.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes, write_bytes

# In one field of a PCD file (the largest of PCL's descriptors has 1,980).
_MOST_VALUES = 4096
# LZF packs at most 264 bytes into three.
_MOST_COMPRESSION = 100
_HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z label timestamp
SIZE 4 4 4 4 8
TYPE F F F U F
COUNT 1 1 1 1 1
WIDTH {points}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {points}
DATA binary
"""
_ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4"), ("timestamp", "<f8")])


def write_pcd(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write x, y, z (float32), label (the laser, as PCL's PointXYZL has it) and timestamp."""
    rows = np.empty(len(columns["x"]), dtype=_ROW)
    for name in _ROW.names or ():
        rows[name] = columns["laser_id" if name == "label" else name]
    write_bytes(path, _HEADER.format(points=len(rows)).encode() + rows.tobytes())


def read_pcd(path: Path) -> dict[str, NDArray[Any]]:
    """Read the fields of a PCD file, (n,) or (n, values) each, by name."""
    try:
        return parse_pcd(read_bytes(path))
    except InputError as error:
        raise error if str(path) in str(error) else InputError(f"{path}: {error}") from error


def parse_pcd(data: bytes) -> dict[str, NDArray[Any]]:
    """Like `read_pcd`, of bytes."""
    head = re.match(rb"(?:[^\n]*\n){0,40}?DATA[ \t]+(\w+)[^\n]*\n", data)
    if head is None:
        raise InputError("not a PCD file")
    lines = [line.split() for line in head.group().decode("ascii", "replace").splitlines()]
    header = {line[0]: line[1:] for line in lines if line}
    try:
        kind = np.dtype(list(_fields(header)))
        points = int(header["POINTS"][0])
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise InputError("the header of the PCD file is damaged") from error
    rows = _rows(data[head.end() :], head.group(1).decode(), kind, points)
    if not 0 < points <= len(rows):
        raise InputError(f"the PCD file tells {points} points and has {len(rows)}")
    return {name: rows[name][:points] for name in kind.names or ()}


def is_gap(name: str) -> bool:
    """Whether `read_pcd` calls a gap between fields so."""
    return re.fullmatch(r"_\d+", name) is not None


def _fields(header: dict[str, list[str]]) -> Iterator[Any]:
    letters = {"F": "f", "U": "u", "I": "i"}
    fields, sizes, types = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = header.get("COUNT", ["1"] * len(fields))
    for place, (name, size, letter, count) in enumerate(
        zip(fields, sizes, types, counts, strict=True)
    ):
        if not 1 <= int(count) <= _MOST_VALUES:
            raise ValueError(f"{count} values in a field")
        shape = () if int(count) == 1 else (int(count),)
        # PCL calls every gap "_".
        yield f"_{place}" if name == "_" else name, f"<{letters[letter]}{int(size)}", shape


def _rows(body: bytes, form: str, kind: np.dtype[Any], points: int) -> NDArray[Any]:
    if form == "ascii":
        return _ascii_rows(body, kind)
    if form == "binary":
        return np.frombuffer(body[: len(body) // kind.itemsize * kind.itemsize], kind)
    if form == "binary_compressed":
        return _compressed_rows(body, kind, points)
    raise InputError(f"a PCD file of the form {form}, not ascii, binary or binary_compressed")


def _ascii_rows(body: bytes, kind: np.dtype[Any]) -> NDArray[Any]:
    try:
        return np.asarray(np.loadtxt(StringIO(body.decode("ascii")), dtype=kind, ndmin=1))
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"the PCD file has a damaged line ({error})") from error


def _compressed_rows(body: bytes, kind: np.dtype[Any], points: int) -> NDArray[Any]:
    """Rows of the compressed form: sizes, then all values of a field before those of the next."""
    import lzf

    packed, size = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
    if size != points * kind.itemsize or not size <= _MOST_COMPRESSION * len(body):
        raise InputError(f"the PCD file tells {points} points and has {size} bytes for them")
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

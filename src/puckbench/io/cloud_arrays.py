"""Clouds as NumPy's files: one array (NPY), or an archive of arrays (NPZ)."""

from __future__ import annotations

import io
import logging
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterable
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from puckbench.core.content import limit_of, read_content
from puckbench.core.errors import InputError, naming
from puckbench.io.point_columns import Columns, named_columns

_POINTS = ("xyz", "points", "position", "positions", "pos", "coords", "vertices", "arr_0")
_PARTS = {
    **dict.fromkeys(_POINTS, ("x", "y", "z")),
    "normals": ("nx", "ny", "nz"),
    **dict.fromkeys(("colours", "colors", "rgb"), ("red", "green", "blue")),
}
"""Names of arrays (n, 3), and those of their columns."""
_MOST_COLUMNS = 256
"""Columns of an array: no points have as many values, but an array on its side does."""
_MOST_OF_FEW = 16
"""Likewise where there are fewer points than columns."""
_ZIP = b"PK\x03\x04"
_DAMAGED = (
    *(EOFError, IndexError, KeyError, MemoryError, OverflowError, RecursionError, SyntaxError),
    *(TypeError, ValueError, tokenize.TokenError),
)
"""What NumPy raises for a header that is damaged."""
_DAMAGED_ZIP = (
    *(EOFError, NotImplementedError, OSError, RuntimeError, ValueError),
    *(zipfile.BadZipFile, zlib.error),
)
_log = logging.getLogger(__name__)


def read_npy(path: Path) -> Columns:
    """Read an array (n, 3 or more), one with named fields, or an archive of such (NPZ).

    An array of floating-point numbers (rows, columns, 3 or more) is an image of a sensor: its
    pixels are the points.

    Raises
    ------
    InputError
        The file is missing or damaged, or holds no points.
    """
    data = read_content(path)
    with naming(path):
        if data.startswith(_ZIP):
            return _archived(data, path)
        return _columns(_array(data))


def _array(data: bytes) -> NDArray[Any]:
    """The array of an NPY file, which must hold all that its header says."""
    stream = io.BytesIO(data)
    try:
        with warnings.catch_warnings(action="ignore"):  # of headers that Python 2 wrote
            version = npy.read_magic(stream)
            read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, _, kind = read(stream)
            _check_shape(shape, kind, len(data) - stream.tell())
            stream.seek(0)
            return np.asarray(np.load(stream, allow_pickle=False))
    except _DAMAGED as error:
        fault = " ".join(str(error).split())
        raise InputError(f"not a readable NumPy array ({fault})") from error


def _check_shape(shape: tuple[int, ...], kind: np.dtype[Any], held: int) -> None:
    """InputError for an array of objects, or one of more bytes than a file has after its header."""
    if kind.hasobject:
        raise InputError("an array of Python objects, not of numbers")
    if min(shape, default=0) < 0 or prod(shape) * kind.itemsize > held:
        raise InputError(f"truncated: {held} bytes are no array {shape} of {kind}")


def _columns(array: NDArray[Any]) -> Columns:
    """Columns of one array: those that it names, or the customary ones."""
    if array.dtype.names:
        flat = array.reshape(-1)
        columns: Columns = {}
        for name in array.dtype.names:
            columns |= _parts(name, flat[name])
        return columns
    is_image = array.ndim == 3 and array.dtype.kind == "f"
    rows = array.reshape(-1, array.shape[-1]) if is_image else array
    if rows.ndim != 2 or rows.shape[1] < 3 or rows.dtype.kind not in "fiu":
        raise InputError(f"expected numbers of shape (n, 3), got {array.dtype} {array.shape}")
    count = rows.shape[1]
    if count > _MOST_COLUMNS or (count > _MOST_OF_FEW and len(rows) < count):
        raise InputError(f"{count} columns: points stand in rows, (n, 3 or more)")
    return named_columns(rows)


def _parts(name: str, values: NDArray[Any]) -> Columns:
    """The columns of an array (n, ...) by their names: nx, ny, nz of normals (n, 3)."""
    flat = values.reshape(len(values), prod(values.shape[1:]))
    parts = _PARTS.get(name.lower(), ())
    if flat.shape[1] == len(parts):
        return {part: flat[:, place] for place, part in enumerate(parts)}
    return {name: flat[:, 0] if flat.shape[1] == 1 else flat}


def _archived(data: bytes, path: Path) -> Columns:
    """Columns of an archive, whose points stand in one of its arrays or in x, y and z.

    Of the other arrays those are taken that have a value or a row for each point.
    """
    contents = _contents(data, limit_of(path))
    of_points = _of_points(contents)
    if not of_points:
        raise InputError(f"no array of points (its arrays: {', '.join(contents) or 'none'})")
    columns: Columns = {}
    for name in of_points:
        with naming(f"array {name}"):
            array = _array(contents[name])
            columns |= _columns(array) if len(of_points) == 1 else {name: _flat(array)}
    points = len(next(iter(columns.values()), ()))
    if any(len(part) != points for part in columns.values()):
        raise InputError("its arrays x, y and z have different lengths")
    for name in (name for name in contents if name not in of_points):
        try:
            values = _array(contents[name])
        except InputError as error:
            _log.warning("%s: array %s is left out: %s", path, name, error)
            continue
        if values.ndim and len(values) == points:
            columns |= _parts(name, values)
    return columns


def _of_points(names: Iterable[str]) -> list[str]:
    """Names of the arrays that have the points: one, or x, y and z."""
    lower = {name.lower(): name for name in names}
    one = next((name for name in _POINTS if name in lower), None)
    if one is None and len(lower) != 1:
        return [lower[axis] for axis in "xyz" if axis in lower]
    return [lower[one]] if one else [*lower.values()]


def _flat(array: NDArray[Any]) -> NDArray[Any]:
    if array.ndim == 0 or array.dtype.kind not in "fiu":
        raise InputError(f"expected numbers of shape (n,), got {array.dtype} {array.shape}")
    return array.reshape(-1)


def _contents(data: bytes, most: int) -> dict[str, bytes]:
    """The files of an archive's arrays, by name."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
            if sum(member.file_size for member in members) > most:
                raise InputError(f"unpacks to more than {most:,} bytes")
            contents = {member.filename[:-4]: archive.read(member) for member in members}
    except _DAMAGED_ZIP as error:
        fault = " ".join(str(error).split())
        raise InputError(f"not a readable NumPy archive ({fault})") from error
    if len(contents) < len(members):
        raise InputError("two arrays of the archive have one name")
    return contents

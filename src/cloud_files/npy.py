"""Arrays of NumPy (.npy, .npz) as clouds."""

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

from cloud_files.content import limit_of, read_content
from cloud_files.point_columns import default_columns
from pointkit.damage import reading
from pointkit.errors import InputError, naming
from pointkit.isolated import Columns

_POINT_ARRAYS = ("xyz", "points", "position", "positions", "pos", "coords", "vertices", "arr_0")
_COLUMN_NAMES = {
    **dict.fromkeys(_POINT_ARRAYS, ("x", "y", "z")),
    "normals": ("nx", "ny", "nz"),
    **dict.fromkeys(("colours", "colors", "rgb"), ("red", "green", "blue")),
}
"""Names of an array's columns, by the array's name."""
_MAX_COLUMNS, _MAX_COLUMNS_OF_FEW_POINTS = 256, 16
"""Maximum columns, in general and with fewer rows than columns; larger arrays are rejected as
transposed."""
_ZIP = b"PK\x03\x04"
_DAMAGE = (
    *(EOFError, IndexError, KeyError, MemoryError, OverflowError, RecursionError, SyntaxError),
    *(TypeError, ValueError, tokenize.TokenError),
)
_ZIP_DAMAGE = (
    *(EOFError, NotImplementedError, OSError, RuntimeError, ValueError),
    *(zipfile.BadZipFile, zlib.error),
)
_log = logging.getLogger(__name__)


def read_npy(path: Path) -> Columns:
    """Read points from a NumPy array (.npy) or an archive of arrays (.npz), without unpickling.

    The points of an .npy file are an array (n, 3 or more), an array with named fields, or a range
    image (rows, columns, 3 or more) of floating-point numbers, whose pixels are points. In an .npz
    archive, the points are the array with a usual name (such as ``xyz``, ``points`` or
    ``vertices``) or the arrays ``x``, ``y`` and ``z``; other arrays with one row for each point are
    attributes. Arrays that are left out are named in a warning.

    Returns
    -------
    dict
        Columns (n,) or (n, values per point) by name.

    Raises
    ------
    InputError
        The file is damaged, larger than its limit, or has no array of points.
    """
    data = read_content(path)
    with naming(path):
        if data.startswith(_ZIP):
            columns = _read_archive(data, path)
        else:
            columns = _array_columns(_read_array(data))
    others = [name for name, values in columns.items() if values.dtype.kind not in "fiub"]
    if others:
        _log.warning("%s: columns without numbers are left out: %s", path, ", ".join(others))
    return columns


def read_array(path: Path) -> NDArray[Any]:
    """Read one NumPy array (.npy) of any shape, without unpickling.

    Raises InputError if the file is damaged, larger than its limit, or has Python objects.
    """
    data = read_content(path)
    with naming(path):
        return _read_array(data)


def _read_array(data: bytes) -> NDArray[Any]:
    stream = io.BytesIO(data)
    # NumPy warns of headers that Python 2 wrote.
    with reading("NumPy array", *_DAMAGE), warnings.catch_warnings(action="ignore"):
        version = npy.read_magic(stream)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = read(stream)
        _check_shape(shape, kind, len(data) - stream.tell())
        stream.seek(0)
        return np.asarray(np.load(stream, allow_pickle=False))


def _check_shape(shape: tuple[int, ...], kind: np.dtype[Any], size: int) -> None:
    if kind.hasobject:
        raise InputError("an array of Python objects, not of numbers")
    if min(shape, default=0) < 0 or prod(shape) * kind.itemsize > size:
        raise InputError(f"truncated: {size} bytes are too few for an array {shape} of {kind}")


def _array_columns(array: NDArray[Any]) -> Columns:
    if array.dtype.names:
        flat = array.reshape(-1)
        columns: Columns = {}
        for name in array.dtype.names:
            columns = _joined(columns, _named_columns(name, flat[name]))
        return columns
    is_image = array.ndim == 3 and array.dtype.kind == "f"
    rows = array.reshape(-1, array.shape[-1]) if is_image else array
    if rows.dtype.kind not in "fiu":
        raise InputError(f"points: not numbers, but an array of {array.dtype}")
    if rows.ndim != 2 or rows.shape[1] < 3:
        raise InputError(f"expected points of shape (n, 3), got {array.shape}")
    count = rows.shape[1]
    if count > _MAX_COLUMNS or (count > _MAX_COLUMNS_OF_FEW_POINTS and len(rows) < count):
        raise InputError(f"{count} columns: transpose it to a row for each point, (n, 3 or more)")
    return default_columns(rows)


def _joined(columns: Columns, more: Columns) -> Columns:
    if twice := columns.keys() & more.keys():
        raise InputError(f"two arrays or fields hold the column {min(twice)}")
    return columns | more


def _named_columns(name: str, values: NDArray[Any]) -> Columns:
    flat = values.reshape(len(values), prod(values.shape[1:]))
    names = _COLUMN_NAMES.get(name.lower(), ())
    if flat.shape[1] == len(names):
        return {column: flat[:, place] for place, column in enumerate(names)}
    return {name: flat[:, 0] if flat.shape[1] == 1 else flat}


def _read_archive(data: bytes, path: Path) -> Columns:
    contents = _archive_members(data, limit_of(path))
    point_arrays = _point_arrays(contents)
    if not point_arrays:
        raise InputError(f"no array of points (its arrays: {', '.join(contents) or 'none'})")
    columns: Columns = {}
    for name in point_arrays:
        with naming(f"array {name}"):
            array = _read_array(contents[name])
            more = _array_columns(array) if len(point_arrays) == 1 else {name: _flat(array)}
            columns = _joined(columns, more)
    points = len(next(iter(columns.values()), ()))
    if any(len(part) != points for part in columns.values()):
        raise InputError("its arrays x, y and z have different lengths")
    for name in (name for name in contents if name not in point_arrays):
        try:
            values = _read_array(contents[name])
        except InputError as error:
            _log.warning("%s: array %s is left out: %s", path, name, error)
            continue
        if values.ndim and len(values) == points:
            columns = _joined(columns, _named_columns(name, values))
        elif values.ndim == 1 or name.lower() in _COLUMN_NAMES:  # not a pose, say
            lengths = (path, name, len(values), points)
            _log.warning("%s: array %s is left out: %d values for %d points", *lengths)
    return columns


def _point_arrays(names: Iterable[str]) -> list[str]:
    names_by_lower = {name.lower(): name for name in names}
    name = next((name for name in _POINT_ARRAYS if name in names_by_lower), None)
    if name is None and len(names_by_lower) != 1:
        return [names_by_lower[axis] for axis in "xyz" if axis in names_by_lower]
    return [names_by_lower[name]] if name else [*names_by_lower.values()]


def _flat(array: NDArray[Any]) -> NDArray[Any]:
    if array.ndim == 0 or array.dtype.kind not in "fiu":
        raise InputError(f"expected numbers of shape (n,), got {array.dtype} {array.shape}")
    return array.reshape(-1)


def _archive_members(data: bytes, limit: int) -> dict[str, bytes]:
    with reading("NumPy archive", *_ZIP_DAMAGE), zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
        if sum(member.file_size for member in members) > limit:
            raise InputError(f"unpacks to more than {limit:,} bytes")
        contents = {member.filename[:-4]: archive.read(member) for member in members}
    if len(contents) < len(members):
        raise InputError("two arrays of the archive have one name")
    return contents

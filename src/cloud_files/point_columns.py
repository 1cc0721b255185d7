"""Interpretation of a file's columns: coordinates, normals, colours, labels and other fields."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Container, Iterable, Mapping
from itertools import filterfalse
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, UncheckedCloud
from pointkit.isolated import Columns

_XYZ = (
    ("x", "y", "z"),
    ("cartesianx", "cartesiany", "cartesianz"),
    *(("easting", "northing", up) for up in ("height", "elevation", "altitude", "z")),
    *(tuple(f"{name}{axis}" for axis in range(3)) for name in ("points:", "points_")),
    *(tuple(f"points_m_xyz{mark}{axis}" for axis in range(3)) for mark in ":_"),
)
"""Names of coordinates in PLY and E57 files, and in files of surveyors, ParaView and VeloView."""
_NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
_COLOURS = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("colorred", "colorgreen", "colorblue"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
WIDE_COLOURS = tuple(f"{name}_16" for name in _COLOURS[0])
"""Names of fields for colours that do not fit in 8 bits."""
_PACKED_COLOURS = ("rgb", "rgba")
_RESERVED = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "label"}
_MAX_STEP = 1e-5
_MAX_COLOUR = 255
_MAX_OFF_UNIT = 0.1
_EXACT_INTEGERS = 2**53


def cloud_from_columns(columns: Mapping[str, NDArray[Any]]) -> UncheckedCloud:
    """Make a cloud from the columns of a file, by their names.

    Parameters
    ----------
    columns
        Arrays (n,) or (n, values) by name. Coordinates, normals and colours are recognised by the
        names that PLY, PCD, LAS and E57 files, surveyors and other programs use, whatever the case
        of their letters; a column ``label`` of integers is the labels. All other numeric columns
        become fields.

    Returns
    -------
    UncheckedCloud
        Coordinates and normals as float64. Colours are converted to 8 bits from 16 bits or from
        shares of 1; where this loses something, the colours of the file are fields, too.

    Raises
    ------
    InputError
        x, y or z is missing or not numeric, or two columns have the same name.
    """
    remaining = {name: _native(np.asarray(values)) for name, values in columns.items()}
    xyz = _pop_triple(remaining, _XYZ)
    if xyz is None:
        names = ", ".join(columns) or "none"
        raise InputError(f"the points have no x, y, z (columns: {names}); name three of them so")
    normals, wide_colours = _pop_triple(remaining, _NORMALS), _pop_triple(remaining, _COLOURS)
    if wide_colours is None:
        wide_colours = _pop_packed_colours(remaining)
    fields = _fields(remaining)
    colours = None
    if wide_colours is not None:
        colours, is_exact = _eight_bits(wide_colours)
        if not is_exact:
            fields |= {name: wide_colours[:, c] for c, name in enumerate(WIDE_COLOURS)}
    labels = _labels(remaining)
    field = fields.pop("label", None)
    if labels is None and field is not None:
        fields[_other_name("label_", fields)] = field
    with np.errstate(invalid="ignore"):  # signalling NaNs
        xyz = np.ascontiguousarray(xyz, dtype=np.float64)
        if normals is not None:
            normals = np.ascontiguousarray(normals, dtype=np.float64)
    return UncheckedCloud(xyz, normals, colours, labels, fields=fields)


def colours_of(columns: Mapping[str, NDArray[Any]]) -> NDArray[Any] | None:
    """Return the colours among a file's columns, (n, 3) in the file's type; None without any."""
    return _pop_triple({name: _native(values) for name, values in columns.items()}, _COLOURS)


def default_columns(rows: NDArray[Any]) -> Columns:
    """Name the columns of an array that has no names for them, by their number and values.

    The first three columns are x, y and z. Of four columns, the last is the intensity. Of six
    columns, the last three are colours if they are integers from 0 to 255, or normals if they are
    unit vectors. Of seven columns, the last four are intensity and colours, in either order. Other
    columns are named by their number, such as ``column_4``.

    Parameters
    ----------
    rows
        The array, (n, 3 or more).

    Returns
    -------
    dict
        Columns (n,) by name.
    """
    names = ["x", "y", "z"]
    colours, normals = ["red", "green", "blue"], ["nx", "ny", "nz"]
    count = rows.shape[1]
    if count == 4:
        names += ["intensity"]
    elif count == 6 and _are_colours(rows[:, 3:]):
        names += colours
    elif count == 6 and _are_normals(rows[:, 3:]):
        names += normals
    elif count == 7 and _are_colours(rows[:, 4:]):
        names += ["intensity", *colours]
    elif count == 7 and _are_colours(rows[:, 3:6]):
        names += [*colours, "intensity"]
    names += [f"column_{place + 1}" for place in range(len(names), count)]
    return {name: rows[:, place] for place, name in enumerate(names)}


def decoded(name: bytes) -> str:
    """Return the name of a field as text.

    A name that is not valid UTF-8 is decoded as Windows-1252, the usual encoding of Windows in
    Western Europe. Bytes that are invalid in this encoding, too, become U+FFFD (the replacement
    character).
    """
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace")


def ascii_name(name: str) -> str:
    """Return a name in the form that PLY permits.

    Letters lose their accents, and all characters but letters, digits and underscores become
    underscores.
    """
    letters = filterfalse(unicodedata.combining, unicodedata.normalize("NFKD", name))
    return re.sub(r"\W+", "_", "".join(letters), flags=re.ASCII)


def ply_columns(fields: Mapping[str, NDArray[Any]]) -> Columns:
    """Convert the fields of a cloud to columns that a PLY file can hold, without loss.

    Integers of 64 bits get the smallest type that holds them, or are split into two columns
    (``NAME_high`` and ``NAME_low``). Other characters than letters, digits and underscores are
    replaced in names; underscores are appended to names that are already taken or have another
    meaning in PLY.

    Parameters
    ----------
    fields
        Arrays (n,) by name.

    Returns
    -------
    dict
        Columns (n,) by name.
    """
    columns: Columns = {}
    for field, values in fields.items():
        name = _other_name(ascii_name(field), _RESERVED)
        while not (typed := _typed_columns(name, values)).keys().isdisjoint(columns):
            name = f"{name}_"
        columns |= typed
    return columns


def _other_name(name: str, taken: Container[str]) -> str:
    while name in taken:
        name = f"{name}_"
    return name


def _typed_columns(name: str, values: NDArray[Any]) -> Columns:
    if values.dtype.kind == "b":
        return {name: values.astype(np.uint8)}
    if values.dtype.kind == "f":
        return {name: values.astype("<f4" if values.dtype.itemsize <= 4 else "<f8")}
    return _integer_columns(name, values) if values.dtype.kind in "iu" else {}


def _integer_columns(name: str, values: NDArray[Any]) -> Columns:
    if values.dtype.itemsize < 8 or not len(values):
        return {name: values}
    low, high = int(values.min()), int(values.max())
    for kind in (np.int32, np.uint32):
        if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max:
            return {name: values.astype(kind)}
    if max(-low, high) <= _EXACT_INTEGERS:
        return {name: values.astype(np.float64)}
    bits = np.ascontiguousarray(values).view(np.uint64)
    halves = (bits >> np.uint64(32), bits & np.uint64(0xFFFFFFFF))
    return {
        f"{name}_{half}": part.astype(np.uint32)
        for half, part in zip(("high", "low"), halves, strict=True)
    }


def _native(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def _normalised(name: str) -> str:
    return re.sub(r"\s*[\[(]m[\])]$", "", name.lower().strip().lstrip("/#").strip())


def coordinate_names(names: Iterable[str]) -> list[str]:
    """Return the names of the columns that hold x, y and z, or an empty list."""
    return _first_triple(names, _XYZ)


def has_coordinates(names: Iterable[str]) -> bool:
    """Return whether columns with these names hold x, y and z."""
    return bool(coordinate_names(names))


def coarse_step(columns: Mapping[str, NDArray[Any]]) -> float | None:
    """Return the resolution of single-precision coordinates, if it is coarse for the cloud.

    Parameters
    ----------
    columns
        Columns of the file by name.

    Returns
    -------
    float or None
        Step between neighbouring single-precision numbers at the cloud. None means that the
        coordinates have double precision, or that the step is at most 1e-5 of the cloud's extent.
    """
    parts = [columns[name] for name in _first_triple(columns, _XYZ)]
    if not parts or any(_native(part).dtype != np.float32 or not len(part) for part in parts):
        return None
    with np.errstate(invalid="ignore"):
        parts = [part[np.isfinite(part)] for part in parts]
    if not all(map(len, parts)):
        return None
    with np.errstate(over="ignore"):
        extent = max(float(np.ptp(part)) for part in parts)
    step = max(float(np.spacing(np.abs(part).max())) for part in parts)
    return step if np.isfinite(extent) and step > _MAX_STEP * extent > 0 else None


def _first_triple(names: Iterable[str], triples: Iterable[tuple[str, ...]]) -> list[str]:
    spelling = {_normalised(name): name for name in names}
    for axes in triples:
        if all(axis in spelling for axis in axes):
            return [spelling[axis] for axis in axes]
    return []


def _pop_triple(columns: Columns, triples: Iterable[tuple[str, ...]]) -> NDArray[Any] | None:
    names = _first_triple(columns, triples)
    for name in names:
        plain = _normalised(name)
        if columns[name].dtype.kind not in "fiu":
            raise InputError(f"the column {plain} holds no numbers ({columns[name].dtype})")
        if sum(_normalised(other) == plain for other in columns) > 1:
            raise InputError(f"two columns are named {plain}")
    return np.column_stack([columns.pop(name) for name in names]) if names else None


def _pop_packed_colours(columns: Columns) -> NDArray[np.uint8] | None:
    for name in _PACKED_COLOURS:
        if name in columns and columns[name].dtype.itemsize == 4:
            bits = np.ascontiguousarray(columns.pop(name)).view(np.uint32)
            shifted = bits[:, None] >> np.array([16, 8, 0], dtype=np.uint32)
            return (shifted & np.uint32(_MAX_COLOUR)).astype(np.uint8)
    return None


def _eight_bits(colours: NDArray[Any]) -> tuple[NDArray[np.uint8], bool]:
    """Return colours in 8 bits, and whether the conversion was lossless."""
    values = np.nan_to_num(colours) if colours.dtype.kind == "f" else colours
    low, high = values.min(initial=0), values.max(initial=0)
    if high > _MAX_COLOUR:
        high_bytes = (np.clip(values, 0, 0xFFFF).astype(np.uint16) >> 8).astype(np.uint8)
        is_exact = (colours % 256 == 0).all() or (colours == high_bytes * np.int64(257)).all()
        return high_bytes, bool(is_exact and low >= 0)
    is_share = colours.dtype.kind == "f" and high <= 1
    scaled = np.clip(values * _MAX_COLOUR if is_share else values, 0, _MAX_COLOUR)
    eight_bits = np.rint(scaled).astype(np.uint8)
    return eight_bits, bool(not is_share and (eight_bits == colours).all())


def _fields(columns: Columns) -> Columns:
    numeric = {name: values for name, values in columns.items() if values.dtype.kind in "fiub"}
    fields: Columns = {}
    for name, values in numeric.items():
        if values.ndim == 1:
            fields[name] = values
        for part in range(values.shape[1] if values.ndim == 2 else 0):
            fields[_other_name(f"{name}_{part}", numeric.keys() | fields)] = values[:, part]
    return fields


def _labels(columns: Columns) -> NDArray[np.int32] | None:
    values = columns.get("label")
    if values is None or values.ndim != 1 or values.dtype.kind not in "iuf":
        return None
    limits = np.iinfo(np.int32)
    whole: Floats = np.asarray(values, dtype=np.float64)
    fits = (whole == np.rint(whole)) & (whole >= limits.min) & (whole <= limits.max)
    return values.astype(np.int32) if fits.all() else None


def _are_colours(values: NDArray[Any]) -> bool:
    if not len(values) or not np.isfinite(values).all():
        return False
    whole = (values == np.rint(values)).all()
    return bool(whole and values.min() >= 0 and 1 < values.max() <= _MAX_COLOUR)


def _are_normals(values: NDArray[Any]) -> bool:
    lengths = np.linalg.norm(np.asarray(values, np.float64), axis=1)
    return bool((np.isnan(lengths) | (lengths == 0) | (np.abs(lengths - 1) < _MAX_OFF_UNIT)).all())

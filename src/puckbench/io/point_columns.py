"""Columns of points, as formats name them, and clouds with their attributes and further fields."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, PointCloud

Columns = dict[str, NDArray[Any]]

_XYZ = (
    ("x", "y", "z"),
    ("cartesianx", "cartesiany", "cartesianz"),
    *(("easting", "northing", up) for up in ("height", "elevation", "altitude", "z")),
    *(tuple(f"{name}{axis}" for axis in range(3)) for name in ("points:", "points_")),
    *(tuple(f"points_m_xyz{mark}{axis}" for axis in range(3)) for mark in ":_"),
)
"""Of PLY, E57, surveyors, ParaView and VeloView."""
_NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
_COLOURS = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("colorred", "colorgreen", "colorblue"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
_PACKED = ("rgb", "rgba")
_OWN = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "label"}
_MOST_STEP = 1e-5
_HIGHEST = 255
_WHOLE_DOUBLES = 2**53


def cloud_of(columns: Mapping[str, NDArray[Any]]) -> PointCloud:
    """The cloud of columns (n,) by name, whatever their case; raises InputError without x, y, z.

    Normals and colours are known by the names that PLY, PCD, LAS and E57 files give them. What
    else there is becomes a field: whole numbers and floating-point numbers as they are, colours of
    more than 8 bits beside the colours made of them.
    """
    left = {name: _native(np.asarray(values)) for name, values in columns.items()}
    xyz = _taken(left, _XYZ)
    if xyz is None:
        named = ", ".join(columns) or "none"
        raise InputError(f"the points have no x, y, z (their columns: {named})")
    normals, colours = _taken(left, _NORMALS), _taken(left, _COLOURS)
    if colours is None:
        colours = _unpacked(left)
    fields = dict(_fields(left))
    shown = None
    if colours is not None:
        shown, is_whole = _eight_bits(colours)
        if not is_whole:
            wide = {f"{name}_16": colours[:, axis] for axis, name in enumerate(_COLOURS[0])}
            fields |= wide
    labels = _labels(left)
    if labels is None and "label" in fields:
        fields["label_"] = fields.pop("label")
    with np.errstate(invalid="ignore"):  # of NaNs that signal
        xyz = np.ascontiguousarray(xyz, dtype=np.float64)
        if normals is not None:
            normals = np.ascontiguousarray(normals, dtype=np.float64)
    return PointCloud(
        xyz,
        normals,
        shown,
        labels,
        fields=fields if labels is None else {n: v for n, v in fields.items() if n != "label"},
    )


def named_columns(rows: NDArray[Any]) -> Columns:
    """Columns of rows (n, 3 or more) without names, by what is customary at their number.

    The fourth of four is the intensity; six end in colours where these are whole numbers from 0 to
    255, else in normals; seven have intensity and colours in either order. Others are numbered.
    """
    names = ["x", "y", "z"]
    colours, normals = ["red", "green", "blue"], ["nx", "ny", "nz"]
    count = rows.shape[1]
    if count == 4:
        names += ["intensity"]
    elif count == 6:
        names += colours if _are_colours(rows[:, 3:]) else normals
    elif count == 7 and _are_colours(rows[:, 4:]):
        names += ["intensity", *colours]
    elif count == 7 and _are_colours(rows[:, 3:6]):
        names += [*colours, "intensity"]
    names += [f"column_{place + 1}" for place in range(len(names), count)]
    return {name: rows[:, place] for place, name in enumerate(names)}


def storable(fields: Mapping[str, NDArray[Any]]) -> Columns:
    """Fields in types and under names that a PLY file can have, without loss.

    Whole numbers of 64 bits get the least type that holds them all; where only 64 bits do, they
    are split (``_high`` and ``_low``). Fields of no numbers are left out.
    """
    found: Columns = {}
    for name, values in fields.items():
        plain = re.sub(r"\W+", "_", name)
        plain = f"{plain}_" if plain in _OWN else plain
        if values.dtype.kind == "b":
            found[plain] = values.astype(np.uint8)
        elif values.dtype.kind == "f":
            found[plain] = values.astype("<f4" if values.dtype.itemsize <= 4 else "<f8")
        elif values.dtype.kind in "iu":
            found |= _whole_numbers(plain, values)
    return found


def _whole_numbers(name: str, values: NDArray[Any]) -> Columns:
    if values.dtype.itemsize < 8 or not len(values):
        return {name: values}
    low, high = int(values.min()), int(values.max())
    for kind in (np.int32, np.uint32):
        if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max:
            return {name: values.astype(kind)}
    if max(-low, high) <= _WHOLE_DOUBLES:
        return {name: values.astype(np.float64)}
    bits = np.ascontiguousarray(values).view(np.uint64)
    halves = (bits >> np.uint64(32), bits & np.uint64(0xFFFFFFFF))
    return {
        f"{name}_{half}": part.astype(np.uint32)
        for half, part in zip(("high", "low"), halves, strict=True)
    }


def _native(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def _plain(name: str) -> str:
    """A column's name in lower case, without marks of a comment and the unit metre."""
    return re.sub(r"\s*[\[(]m[\])]$", "", name.lower().strip().lstrip("/#").strip())


def names_coordinates(names: Iterable[str]) -> bool:
    """Whether some names of columns are those of coordinates."""
    return bool(_first_known(names, _XYZ))


def coarse_step(columns: Mapping[str, NDArray[Any]]) -> float | None:
    """Step of coordinates in single precision that lie far from 0; None where it does no harm.

    It does where it is more than a hundred-thousandth of the extent, as in surveyed coordinates.
    """
    parts = [columns[name] for name in _first_known(columns, _XYZ)]
    if not parts or any(_native(part).dtype != np.float32 or not len(part) for part in parts):
        return None
    with np.errstate(invalid="ignore"):
        parts = [part[np.isfinite(part)] for part in parts]
    if not all(map(len, parts)):
        return None
    with np.errstate(over="ignore"):
        extent = max(float(np.ptp(part)) for part in parts)
    step = max(float(np.spacing(np.abs(part).max())) for part in parts)
    return step if np.isfinite(extent) and step > _MOST_STEP * extent > 0 else None


def _first_known(names: Iterable[str], known: Iterable[tuple[str, ...]]) -> list[str]:
    """The first known triple among names of columns, as they are written; else none."""
    places = {_plain(name): name for name in names}
    for axes in known:
        if all(axis in places for axis in axes):
            return [places[axis] for axis in axes]
    return []


def _taken(columns: Columns, known: Iterable[tuple[str, ...]]) -> NDArray[Any] | None:
    """The first known triple of columns, side by side (n, 3), removed from the others."""
    names = _first_known(columns, known)
    for name in names:
        if columns[name].dtype.kind not in "fiu":
            raise InputError(f"the column {_plain(name)} holds no numbers ({columns[name].dtype})")
        if sum(_plain(other) == _plain(name) for other in columns) > 1:
            raise InputError(f"two columns are named {_plain(name)}")
    return np.column_stack([columns.pop(name) for name in names]) if names else None


def _unpacked(columns: Columns) -> NDArray[np.uint8] | None:
    """Colours (n, 3) of a number with red, green and blue in its lowest 24 bits, as in PCD."""
    for name in _PACKED:
        if name in columns and columns[name].dtype.itemsize == 4:
            bits = np.ascontiguousarray(columns.pop(name)).view(np.uint32)
            shifted = bits[:, None] >> np.array([16, 8, 0], dtype=np.uint32)
            return (shifted & np.uint32(_HIGHEST)).astype(np.uint8)
    return None


def _eight_bits(colours: NDArray[Any]) -> tuple[NDArray[np.uint8], bool]:
    """Colours (n, 3) as whole numbers to 255, and whether nothing is lost by that."""
    if colours.dtype.kind == "f":
        high = np.nan_to_num(colours).max(initial=0)
        scaled = np.clip(np.nan_to_num(colours * (_HIGHEST if high <= 1 else 1)), 0, _HIGHEST)
        return np.rint(scaled).astype(np.uint8), bool(high > 1 and (scaled == colours).all())
    if colours.max(initial=0) <= _HIGHEST:
        return colours.astype(np.uint8), True
    high_bytes = (np.clip(colours, 0, 0xFFFF).astype(np.uint16) >> 8).astype(np.uint8)
    whole = (colours % 256 == 0).all() or (colours == high_bytes * np.int64(257)).all()
    return high_bytes, bool(whole)


def _fields(columns: Columns) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, values in columns.items():
        if values.ndim == 1 and values.dtype.kind in "fiub":
            yield name, values
        elif values.ndim == 2 and values.dtype.kind in "fiub":
            yield from ((f"{name}_{part}", values[:, part]) for part in range(values.shape[1]))


def _labels(columns: Columns) -> NDArray[np.int32] | None:
    """The column ``label``, where 32 bits hold its whole numbers."""
    values = columns.get("label")
    if values is None or values.ndim != 1 or values.dtype.kind not in "iuf":
        return None
    limits = np.iinfo(np.int32)
    whole: Floats = np.asarray(values, dtype=np.float64)
    fits = (whole == np.rint(whole)) & (whole >= limits.min) & (whole <= limits.max)
    return values.astype(np.int32) if fits.all() else None


def _are_colours(values: NDArray[Any]) -> bool:
    """Whether numbers (n, 3) are whole, from 0 to 255, and not all 0 or 1."""
    if not len(values) or not np.isfinite(values).all():
        return False
    whole = (values == np.rint(values)).all()
    return bool(whole and values.min() >= 0 and 1 < values.max() <= _HIGHEST)

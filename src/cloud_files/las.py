"""LAS and LAZ files (ASPRS), read and written by the packages laspy and lazrs.

Files are parsed in a process of their own, because lazrs aborts its process for some damaged files.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import date
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.las_header import check_las_header
from cloud_files.las_units import METRE, Units, has_system, las_units, unit_name
from pointkit.damage import PARSER_FAULTS, reading
from pointkit.errors import InputError, naming
from pointkit.files import write_bytes
from pointkit.isolated import ParsedFile, parse_isolated

_LOG = logging.getLogger(__name__)
_STEP_M = 1e-4
_DATE = date(2000, 1, 1)
"""Fixed creation date, so that equal points give equal files."""
_AXES = ("x", "y", "z")
_COLOURS = ("red", "green", "blue")
_MOST_LETTERS = 32
"""Length limit of the names of extra bytes."""
_OF_LAS_1_4 = range(6, 11)
"""Point formats of LAS 1.4."""
_NARROW = {"classification": (5, 8), "return_number": (3, 4), "number_of_returns": (3, 4)}
"""Numbers of bits that a value has in point formats 0 to 5, and in those of LAS 1.4, by the name of
the dimension."""
_MOST_WHOLE = 1 << 53
_COLUMN_NAMES = {
    "intensity": "reflectivity",
    "user_data": "laser_id",
    "point_source_id": "turn",
    "gps_time": "timestamp",
}


def write_las(
    path: str | Path,
    columns: Mapping[str, NDArray[Any]],
    others: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write the returns of a LiDAR as a LAS file or, if `path` ends in ``.laz``, as a LAZ file.

    Parameters
    ----------
    path
        The file to write.
    columns
        Arrays (n,) by name. x, y and z are in metres and are rounded to 0.1 mm. Optional columns
        are ``reflectivity`` (written as intensity), ``laser_id`` (as user data), ``turn`` or
        ``frame``, i.e. the number of the sensor's revolution (as point source id),
        ``timestamp`` (as GPS time), and ``red``, ``green`` and ``blue`` of 8 or 16 bits. Other
        columns are not written.
    others
        Further columns, (n,), of numbers. Those that have the name of a dimension of LAS, and fit
        in it, are written as this dimension, and all others as extra bytes. Classes above 31 and
        numbers of returns above 7 need LAS 1.4 (point format 6 or 7), which is written for them;
        otherwise the file is LAS 1.2 (point format 1 or 3).

    Raises
    ------
    InputError
        The points lie more than 214 km apart, or `path` is the name of a COPC file.
    """
    refuse_copc(path)
    others = others or {}
    las = _las_data(columns, any(_is_wide(others, *each) for each in _NARROW.items()))
    for name, values in others.items():
        _add_dimension(las, name, values)
    write_bytes(path, las_bytes(las, Path(path).suffix.lower() == ".laz"))


def refuse_copc(path: str | Path) -> None:
    """Raise InputError for the name of a COPC file (``.copc.laz``), which is not written."""
    if Path(path).name.lower().endswith(".copc.laz"):
        raise InputError(f"{path}: COPC files are not written: name it .laz")


def _is_wide(columns: Mapping[str, NDArray[Any]], name: str, bits: tuple[int, int]) -> bool:
    """Return whether the numbers of a column fit only in the second of two numbers of bits."""
    largest = columns[name].max(initial=0) if name in columns else 0
    return bool(1 << bits[0] <= largest < 1 << bits[1])


def _add_dimension(las: Any, name: str, values: NDArray[Any]) -> None:
    import laspy

    if name in las.point_format.dimension_names:
        blank = np.array(las[name])
        with suppress(OverflowError, TypeError):
            las[name] = _as_integers(values)
        if np.array_equal(las[name], values):
            return
        las[name] = blank
        name = f"{name}_"
    kind = np.uint8 if values.dtype.kind == "b" else values.dtype.newbyteorder("=")
    las.add_extra_dim(laspy.ExtraBytesParams(name[:_MOST_LETTERS], kind))
    las[name[:_MOST_LETTERS]] = values


def _as_integers(values: NDArray[Any]) -> NDArray[Any]:
    """Return numbers as integers if all of them are whole, since bits take no other numbers."""
    is_whole = values.dtype.kind == "f" and (np.abs(values) < _MOST_WHOLE).all()
    return values.astype(np.int64) if is_whole and (values == np.floor(values)).all() else values


def wide_colours_of(colours: NDArray[Any]) -> NDArray[np.uint16]:
    """Return colours in 16 bits, as LAS has them, from 8 or 16 bits."""
    return colours.astype(np.uint16) * 257 if colours.dtype == np.uint8 else colours


def las_bytes(las: Any, is_compressed: bool) -> bytes:
    """Return a LAS file's content as bytes.

    Parameters
    ----------
    las
        The points, as laspy's `LasData`.
    is_compressed
        Whether to return a LAZ file.
    """
    import laspy

    content = BytesIO()
    las.write(content, do_compress=is_compressed, laz_backend=laspy.LazBackend.Lazrs)
    return content.getvalue()


def read_las(path: Path) -> dict[str, NDArray[Any]]:
    """Read a file that `write_las` wrote; return its columns (n,) under their original names."""
    columns = parse_isolated(parse_las, path, "LAS file").columns
    names = {**{axis: axis for axis in _AXES}, **_COLUMN_NAMES}
    return {names[name]: part for name, part in columns.items() if name in names}


def read_las_points(path: Path, convert: bool = True) -> dict[str, NDArray[Any]]:
    """Read the points of a LAS or LAZ file.

    Parameters
    ----------
    path
        The file.
    convert
        Whether to convert coordinates to metres from the unit of the file's coordinate reference
        system. Without one, they are taken as metres.

    Returns
    -------
    dict
        Columns (n,) by name: x, y and z, and all dimensions of the file, extra bytes included,
        that are not 0 everywhere.

    Raises
    ------
    InputError
        The file is damaged, or its coordinates are degrees.
    """
    columns = parse_isolated(parse_las, path, "LAS file", {"convert": convert}).columns
    return {name: part for name, part in columns.items() if name in _AXES or np.count_nonzero(part)}


@contextmanager
def reading_las(path: Path) -> Iterator[None]:
    """Check the header of a LAS file, and convert what laspy raises in the block to InputError."""
    import laspy
    from lazrs import LazrsError

    check_las_header(path)
    with naming(path), reading("LAS file", laspy.LaspyException, LazrsError, *PARSER_FAULTS):
        yield


def parse_las(path: Path, convert: bool = True) -> ParsedFile:
    """Read a LAS or LAZ file as `read_las_points` does, but in the calling process.

    Returns
    -------
    ParsedFile
        All dimensions of the file.
    """
    import laspy

    with reading_las(path):
        with laspy.open(path, laz_backend=laspy.LazBackend.LazrsParallel) as reader:
            metres = _metres_per_unit(reader.header, path) if convert else None
            points = reader.read_points(-1)
        names = [
            name for name in points.point_format.dimension_names if name not in ("X", "Y", "Z")
        ]
        columns = {
            f"{name}_" if name in _AXES else name: np.asarray(
                points.array[name] if name in _AXES else points[name]
            )
            for name in names
        }
        return ParsedFile({**_coordinates(points, metres), **columns})


def units_of(header: Any) -> Units | None:
    """Return the units of a LAS file's coordinates.

    Parameters
    ----------
    header
        Header of the file, from laspy.

    Returns
    -------
    Units or None
        The units; None if the file's coordinate reference system cannot be read.
    """
    from pyproj.exceptions import CRSError

    try:
        return las_units(header)
    except CRSError:
        return None


def _metres_per_unit(header: Any, path: Path) -> tuple[float, float, float] | None:
    if (units := units_of(header)) is None:
        _LOG.warning("%s: its coordinate reference system is not readable: metres assumed", path)
        return None
    if units.is_unknown and has_system(header):
        _LOG.warning("%s: its coordinate reference system states no unit: metres assumed", path)
    if units.is_degrees:
        raise InputError(f"{path}: its coordinates are degrees: project it first (pdal, las2las)")
    horizontal, vertical = units.horizontal or METRE, units.vertical or METRE
    if horizontal == vertical == METRE:
        return None
    text = unit_name(horizontal)
    if vertical != horizontal:
        text += f" and its heights in {unit_name(vertical)}"
    _LOG.warning("%s: its coordinates are in %s: converted to metres", path, text)
    return horizontal, horizontal, vertical


def _coordinates(points: Any, metres: tuple[float, ...] | None) -> dict[str, NDArray[np.float64]]:
    axes = {axis: np.asarray(points[axis], dtype=np.float64) for axis in _AXES}
    if metres is None:
        return axes
    return {axis: axes[axis] * length for axis, length in zip(_AXES, metres, strict=True)}


def las_points(steps: NDArray[Any], step: float, offset: Any, point_format: int) -> Any:
    """Create laspy's `LasData` with points on a grid; all their attributes are 0.

    Parameters
    ----------
    steps
        Positions of the points in grid steps, (n, 3), integers of at most 32 bits.
    step
        Length of a grid step, m.
    offset
        Position of the grid's origin, (3,), m.
    point_format
        Number of the LAS point format, which says which attributes a point has. The file is LAS 1.4
        for formats from 6 on, which demand it, and else LAS 1.2.

    Returns
    -------
    LasData
        Points at ``offset + step * steps``.
    """
    import laspy

    version = "1.4" if point_format in _OF_LAS_1_4 else "1.2"
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.global_encoding.wkt = point_format in _OF_LAS_1_4
    header.scales, header.offsets = np.full(3, step), offset
    header.creation_date = _DATE
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(steps), header=header))
    las.X, las.Y, las.Z = steps.astype(np.int32).T
    return las


def _las_data(columns: Mapping[str, NDArray[Any]], is_wide: bool) -> Any:
    xyz = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
    offset = np.floor(xyz.min(axis=0))
    counts = np.rint((xyz - offset) / _STEP_M)
    if counts.max() > np.iinfo(np.int32).max:
        raise InputError("the points lie too far apart for LAS (more than 214 km)")
    has_colours = all(name in columns for name in _COLOURS)
    point_format = {(False, False): 1, (True, False): 3, (False, True): 6, (True, True): 7}[
        has_colours, is_wide
    ]
    las = las_points(counts, _STEP_M, offset, point_format)
    las.header.system_identifier = "EXPORT"
    las.header.generating_software = f"puckbench {version('cloud_files')}"
    las.return_number[:] = las.number_of_returns[:] = 1
    unknown = np.zeros(len(xyz))
    las.intensity = np.clip(np.rint(columns.get("reflectivity", unknown)), 0, 0xFFFF)
    las.user_data = columns.get("laser_id", unknown)
    las.point_source_id = np.clip(columns.get("turn", columns.get("frame", unknown)), 0, 0xFFFF)
    las.gps_time = columns.get("timestamp", unknown)
    for name in _COLOURS if has_colours else ():
        las[name] = wide_colours_of(columns[name])
    return las

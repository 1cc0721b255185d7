"""Units of the coordinates of LAS files, from their coordinate reference systems."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

METRE, FOOT, US_SURVEY_FOOT = 1.0, 0.3048, 1200 / 3937
_TOLERANCE = 1e-7
"""Relative tolerance of units in files; the two kinds of feet differ by 2e-6."""
_PROJECTED, _LINEAR_UNIT, _UNIT_SIZE = 3072, 3076, 3077
_VERTICAL, _VERTICAL_UNIT = 4096, 4099
_MODEL, _GEOGRAPHIC_MODEL = 1024, 2
_USER_DEFINED = 32767
_PROJECTION, _KEYS_RECORD, _WKT_RECORD = "LASF_Projection", 34735, 2112
_KEYS_HEADER_BYTES = 8
_DOUBLES = 34736
"""Tag of GeoTIFF's double values; the constants above are GeoTIFF keys and codes."""


@dataclass(frozen=True)
class Units:
    """The units of a file's coordinates.

    Parameters
    ----------
    horizontal
        Length of the unit of x and y in metres; None if unknown.
    vertical
        Length of the unit of z in metres; None if unknown.
    is_degrees
        Whether x and y are degrees of longitude and latitude.
    """

    horizontal: float | None = None
    vertical: float | None = None
    is_degrees: bool = False

    @property
    def is_unknown(self) -> bool:
        return self.horizontal is None and not self.is_degrees


def las_units(header: Any) -> Units:
    """Return the units of the coordinates of a LAS file.

    As in GDAL, units in GeoTIFF keys take precedence over those of the coordinate reference system.
    Raises `pyproj.exceptions.CRSError` if the system cannot be read.

    Parameters
    ----------
    header
        Header of the file, from laspy.

    Returns
    -------
    Units
        The units.
    """
    crs = header.parse_crs() or _crs_in_latin(header)
    units = Units() if crs is None else _units_of_crs(crs)
    records = header.vlrs.get("GeoKeyDirectoryVlr")
    if records and not header.vlrs.get("WktCoordinateSystemVlr"):
        units = _with_keys(units, *_keys(records[0], header.vlrs.get("GeoDoubleParamsVlr")))
    vertical = units.horizontal if units.vertical is None else units.vertical
    return Units(units.horizontal, vertical, units.is_degrees)


def has_system(header: Any) -> bool:
    """Return whether a LAS file has a coordinate reference system, even one that cannot be read.

    Parameters
    ----------
    header
        Header of the file, from laspy.
    """
    contents = {record.record_id: record.record_data_bytes() for record in _system_records(header)}
    return len(contents.get(_KEYS_RECORD, b"")) > _KEYS_HEADER_BYTES or bool(
        contents.get(_WKT_RECORD, b"").strip(b"\0 \n")
    )


def _system_records(header: Any) -> list[Any]:
    records = [*header.vlrs, *(header.evlrs or ())]
    return [record for record in records if record.user_id == _PROJECTION]


def _crs_in_latin(header: Any) -> Any:
    """Return a coordinate reference system whose text laspy cannot read, since it is not UTF-8."""
    import pyproj
    from laspy import VLR

    for record in _system_records(header):
        if record.record_id == _WKT_RECORD and isinstance(record, VLR):
            return pyproj.CRS.from_wkt(record.record_data.decode("latin-1").rstrip("\0"))
    return None


def _units_of_crs(crs: Any) -> Units:
    axes = {axis.direction in ("up", "down"): axis for axis in reversed(crs.axis_info)}
    horizontal, vertical = (
        _metres(axes[is_vertical].unit_conversion_factor) if is_vertical in axes else None
        for is_vertical in (False, True)
    )
    if crs.is_geographic:
        return Units(None, vertical, is_degrees=True)
    return Units(horizontal, vertical)


def _keys(directory: Any, doubles: list[Any]) -> tuple[dict[int, int], dict[int, float]]:
    short = {key.id: key.value_offset for key in directory.geo_keys if not key.tiff_tag_location}
    values = [float(value.value) for value in doubles[0].doubles] if doubles else []
    return short, {
        key.id: values[key.value_offset]
        for key in directory.geo_keys
        if key.tiff_tag_location == _DOUBLES and key.value_offset < len(values)
    }


def _with_keys(units: Units, short: dict[int, int], doubles: dict[int, float]) -> Units:
    import pyproj

    if short.get(_MODEL) == _GEOGRAPHIC_MODEL and _PROJECTED not in short:
        return Units(None, units.vertical, is_degrees=True)
    horizontal = _unit(short.get(_LINEAR_UNIT), doubles.get(_UNIT_SIZE)) or units.horizontal
    vertical = _unit(short.get(_VERTICAL_UNIT)) or units.vertical
    code = short.get(_VERTICAL, _USER_DEFINED)
    if vertical is None and 1024 <= code < _USER_DEFINED:
        vertical = _units_of_crs(pyproj.CRS.from_epsg(code)).vertical
    return Units(horizontal, vertical, units.is_degrees)


def _unit(code: int | None, size: float | None = None) -> float | None:
    from pyproj.database import get_units_map

    if code == _USER_DEFINED:
        return None if size is None else _metres(size)
    units = get_units_map(auth_name="EPSG", category="linear").values()
    return next((_metres(unit.conv_factor) for unit in units if unit.code == str(code)), None)


def _metres(factor: float) -> float | None:
    if not 0 < factor < math.inf:
        return None
    exact = (METRE, FOOT, US_SURVEY_FOOT)
    return next((unit for unit in exact if math.isclose(unit, factor, rel_tol=_TOLERANCE)), factor)


def unit_name(metres: float) -> str:
    """Return the name, for messages, of the unit of length with the given length in metres."""
    names = {METRE: "metres", FOOT: "feet", US_SURVEY_FOOT: "US survey feet"}
    return names.get(metres, f"units of {metres:g} m")

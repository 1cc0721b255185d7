"""Writing of changed points to a LAS file that otherwise keeps the content of another LAS file."""

from __future__ import annotations

import logging
import struct
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.content import unpacked
from cloud_files.las import las_bytes, reading_las, refuse_copc, units_of
from cloud_files.las_units import METRE, Units
from pointkit.errors import InputError
from pointkit.files import write_bytes
from pointkit.isolated import ParsedFile, parse_isolated

_LOG = logging.getLogger(__name__)
_DATE = slice(90, 94)
"""Bytes of the creation date, as which laspy writes today's if it is not valid."""
_MINOR_AT = 25
_WAVEFORMS_AT, _OFFSET = 227, struct.Struct("<Q")
_EXTENDED_AT, _EXTENDED = 235, struct.Struct("<QI")
"""Offset and number of extended variable length records (LAS 1.4)."""
_RECORD = struct.Struct("<2x16sHQ32x")
"""Header of an extended variable length record: user, number and length of the content."""
_WAVEFORMS = (b"LASF_Spec", 65535)
_LAYERED_WAVEFORMS = (9, 10)
"""Point formats whose waveform fields lazrs damages if there are several scanner channels."""
_OF_CHUNKS = "copc"
"""User of records that describe the chunks of a COPC file."""


def rewrite_las(
    path: str | Path,
    source: str | Path,
    points: NDArray[np.float64],
    rows: NDArray[np.int64],
    metres_per_unit: float = 1.0,
    replaced: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write points to a LAS or LAZ file that otherwise keeps the content of another LAS file.

    The header, the records and the attributes of points come from the file `source`.

    Parameters
    ----------
    path
        The file to write: a LAZ file if the suffix is ``.laz``, otherwise a LAS file.
    source
        The LAS or LAZ file whose header (version, point format, scale, offset), records and
        waveforms are kept.
    points
        Coordinates (m, 3) in metres, which are converted to the unit of `source`.
    rows
        Number of the point in `source` from which each written point takes its attributes, (m,). It
        is -1 for a point whose attributes are 0.
    metres_per_unit
        Length of one unit of `source` in metres. If it is 1, the unit is taken from the coordinate
        reference system of `source`.
    replaced
        Values (m,) by name of a dimension, that replace those of `source`; names that the point
        format lacks are left out.

    Raises
    ------
    InputError
        `path` is the name of a COPC file, `source` is unreadable, its scale and offset cannot
        represent a point, or LAZ cannot hold its waveforms.
    """
    import laspy

    refuse_copc(path)
    with unpacked(Path(source)) as plain:
        parts = parse_isolated(parse_las_file, plain, "LAS file").columns
    las = laspy.read(BytesIO(parts["bytes"].tobytes()))
    steps = np.rint(
        (points / _units(las.header, metres_per_unit) - las.header.offsets) / las.header.scales
    )
    if not (np.abs(steps) <= np.iinfo(np.int32).max).all():
        raise InputError(f"{path}: points outside the range of the scale and offset of {source}")
    las.points = las.points[np.maximum(rows, 0)]
    las.points.array[rows < 0] = 0
    las.X, las.Y, las.Z = steps.astype(np.int32).T
    for name, values in (replaced or {}).items():
        if name in las.point_format.dimension_names:
            las[name] = values
    is_compressed = Path(path).suffix.lower() == ".laz"
    content = bytearray(las_bytes(las, is_compressed))
    if is_compressed and las.point_format.id in _LAYERED_WAVEFORMS:
        _check_compressed(las, bytes(content), path)
    content[_DATE] = parts["date"].tobytes()
    _place_waveforms(content, parts["waveforms"].tobytes())
    if las.header.global_encoding.waveform_data_packets_external:
        _LOG.warning("%s: the waveforms remain in a file (.wdp) beside %s", path, source)
    write_bytes(path, bytes(content))


def _units(header: Any, metres_per_unit: float) -> NDArray[np.float64]:
    if metres_per_unit != METRE:
        return np.full(3, metres_per_unit)
    units = units_of(header) or Units()
    horizontal = units.horizontal or METRE
    return np.array([horizontal, horizontal, units.vertical or METRE])


def _check_compressed(las: Any, content: bytes, path: str | Path) -> None:
    import laspy

    back = laspy.read(BytesIO(content)).points.array
    if back.tobytes() != las.points.array.tobytes():
        raise InputError(f"{path}: its waveforms cannot be written as LAZ: name it .las")


def _place_waveforms(content: bytearray, record: bytes) -> None:
    """Append the `record` of waveforms to a LAS 1.3 file, and set its offset in the header."""
    if content[_MINOR_AT] < 3:
        return
    offset = len(content) if record else 0
    if content[_MINOR_AT] >= 4:
        offset = _extended_waveforms(content)
    content += record
    _OFFSET.pack_into(content, _WAVEFORMS_AT, offset)


def _extended_waveforms(content: bytearray) -> int:
    """Return the offset of the waveforms among a file's extended records; 0 without any."""
    offset, records = _EXTENDED.unpack_from(content, _EXTENDED_AT)
    for _ in range(records):
        user, number, length = _RECORD.unpack_from(content, offset)
        if (user.rstrip(b"\0"), number) == _WAVEFORMS:
            return int(offset)
        offset += _RECORD.size + length
    return 0


def parse_las_file(path: Path) -> ParsedFile:
    """Read a LAS or LAZ file as an uncompressed LAS file, with what laspy would lose of it.

    Returns
    -------
    ParsedFile
        Three columns of bytes: ``bytes`` is the LAS file, without the records that describe the
        chunks of a COPC file; ``date`` is the date of creation; ``waveforms`` is the record of
        waveforms in LAS 1.3, often empty.
    """
    import laspy

    with reading_las(path):
        las = laspy.read(path)
        record = _waveforms(path, las.header)
        for records in filter(None, (las.vlrs, las.evlrs)):
            records[:] = [one for one in records if one.user_id != _OF_CHUNKS]
        parts = {
            "bytes": las_bytes(las, is_compressed=False),
            "date": path.read_bytes()[_DATE],
            "waveforms": record,
        }
    return ParsedFile({name: np.frombuffer(part, np.uint8) for name, part in parts.items()})


def _waveforms(path: Path, header: Any) -> bytes:
    """Return the record of the waveforms behind the points of a LAS 1.3 file, if it has any."""
    offset = header.start_of_waveform_data_packet_record
    if header.version.minor != 3 or not offset:
        return b""
    with path.open("rb") as stream:
        stream.seek(offset)
        head = stream.read(_RECORD.size)
        if len(head) < _RECORD.size:
            return b""
        return head + stream.read(_RECORD.unpack(head)[2])

"""Checks of the sizes in the header of a LAS file, before a parser relies on them."""

from __future__ import annotations

import logging
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pointkit.damage import reading
from pointkit.errors import naming

_POINT_BYTES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""Sizes of points of formats 0 to 10, without extra bytes."""
_LOG = logging.getLogger(__name__)
_HEADER_BYTES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
"""Header size by minor version of the format."""
_LAYOUT_AT, _LAYOUT = 94, struct.Struct("<HIIBHI")
"""Header size, offset to point data, number of variable length records, point format, point size,
number of points."""
_SCALING_AT, _SCALING = 131, struct.Struct("<6d")
"""Scales and offsets of x, y and z."""
_WAVEFORMS_AT, _WAVEFORMS = 227, struct.Struct("<Q")
_EXTENDED_AT, _EXTENDED = 235, struct.Struct("<QIQ")
"""Offset and number of extended variable length records, number of points (LAS 1.4)."""
_RECORD, _EXTENDED_RECORD = struct.Struct("<2x16sHH32x"), struct.Struct("<2x16sHQ32x")
"""Headers of variable length records: user, number and length of the content."""
_EXTRA_BYTES = (b"LASF_Spec", 4)
_COMPRESSED = 0xC0
"""Bits of the point format field; LAZ files set one of these bits."""
_MAX_COMPRESSION = 1000
"""Maximum compression ratio of LAZ; a header that implies a larger one is damaged."""


@dataclass(frozen=True)
class _LasHeader:
    length: int
    begin: int
    records: int
    point_format: int
    point_bytes: int
    points: int
    legacy_points: int
    is_compressed: bool
    waveforms: int
    extended_at: int
    extended_records: int


def check_las_header(path: Path) -> None:
    """Check that the header of a LAS or LAZ file fits the rest of the file.

    Raises InputError if points or records would lie beyond the end of the file, or a scale or an
    offset is of no use. Points after those that the header counts are told in a warning.
    """
    size = path.stat().st_size
    with naming(path), reading("LAS file", ValueError), path.open("rb") as stream:
        start = stream.read(max(_HEADER_BYTES.values()))
        header = _header(start)
        _check_points(header, size)
        _check_scaling(start)
        names = _check_records(stream, header.length, header.records, header.begin, _RECORD)
        extended = (header.extended_at, header.extended_records)
        _check_records(stream, *extended, size, _EXTENDED_RECORD)
    if _EXTRA_BYTES in names and header.point_bytes == _POINT_BYTES[header.point_format]:
        _LOG.warning("%s: its points lack the extra bytes that a record describes", path)
    count = 0 if header.is_compressed else _points_beyond(header, size)
    if count:
        message = "%s: its header says %d points: the %d after them are left out"
        _LOG.warning(message, path, header.points, count)


def _header(start: bytes) -> _LasHeader:
    if start[:4] != b"LASF":
        raise ValueError("it does not begin with LASF")
    if len(start) < _HEADER_BYTES[0]:
        raise ValueError("its header is cut short")
    major, minor = start[24:26]
    if major != 1 or minor not in _HEADER_BYTES:
        raise ValueError(f"version {major}.{minor}")
    length, begin, records, kind, point_bytes, points = _LAYOUT.unpack_from(start, _LAYOUT_AT)
    if min(length, len(start)) < _HEADER_BYTES[minor]:
        raise ValueError("its header is cut short")
    if (point_format := kind & ~_COMPRESSED) >= len(_POINT_BYTES):
        raise ValueError(f"point format {point_format}")
    waveforms, extended_at, extended_records, legacy_points = 0, 0, 0, points
    if minor >= 3:
        (waveforms,) = _WAVEFORMS.unpack_from(start, _WAVEFORMS_AT)
    if minor >= 4:
        extended_at, extended_records, points = _EXTENDED.unpack_from(start, _EXTENDED_AT)
    counts = (point_format, point_bytes, points, legacy_points, bool(kind & _COMPRESSED))
    others = (waveforms, extended_at, extended_records)
    return _LasHeader(length, begin, records, *counts, *others)


def _check_points(header: _LasHeader, size: int) -> None:
    if not header.length <= header.begin <= size:
        raise ValueError(f"its points begin at byte {header.begin} of {size}")
    if not header.point_bytes:
        raise ValueError("its points have no bytes")
    if header.legacy_points > header.points == 0:
        raise ValueError(f"its header says 0 points, and {header.legacy_points} in a legacy field")
    most = (size - header.begin) // header.point_bytes
    if header.is_compressed:
        most *= _MAX_COMPRESSION
    if header.points > most:
        raise ValueError(f"it is cut short: {header.points} points in its header, room for {most}")


def _check_scaling(start: bytes) -> None:
    numbers = _SCALING.unpack_from(start, _SCALING_AT)
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a scale or an offset is not finite")
    if not all(numbers[:3]):
        raise ValueError("a scale is 0")


def _check_records(
    stream: BinaryIO, begin: int, count: int, end: int, layout: struct.Struct
) -> list[tuple[bytes, int]]:
    """Return the user and number of each record; raise ValueError if a record ends after `end`."""
    if count * layout.size > max(0, end - begin):
        raise ValueError(f"{count} variable length records in {max(0, end - begin)} bytes")
    offset, names = begin, []
    for _ in range(count):
        stream.seek(offset)
        head = stream.read(layout.size)
        offset += layout.size
        if offset <= end:
            user, number, length = layout.unpack(head)
            names.append((user.rstrip(b"\0"), number))
            offset += length
        if offset > end:
            raise ValueError("its variable length records are cut short")
    return names


def _points_beyond(header: _LasHeader, size: int) -> int:
    end = header.begin + header.points * header.point_bytes
    after = [offset for offset in (header.waveforms, header.extended_at) if offset >= end]
    return int((min([size, *after]) - end) // header.point_bytes)

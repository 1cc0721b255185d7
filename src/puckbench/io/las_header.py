"""The header of a LAS or LAZ file (ASPRS LAS 1.0 to 1.5), checked against the file's size."""

from __future__ import annotations

import logging
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from puckbench.core.errors import InputError

_LOG = logging.getLogger(__name__)
_HEADER_BYTES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
"""Of each minor version."""
_STARTS_AT, _STARTS = 94, struct.Struct("<HIIBHI")
"""Bytes of the header, where points begin, number of records before them, point format, bytes of a
point, number of points."""
_WAVEFORMS_AT, _WAVEFORMS = 227, struct.Struct("<Q")
_EXTENDED_AT, _EXTENDED = 235, struct.Struct("<QIQ")
"""Where records after the points begin, their number, and the number of points (LAS 1.4)."""
_RECORD, _EXTENDED_RECORD = struct.Struct("<20xH32x"), struct.Struct("<20xQ32x")
_COMPRESSED = 0xC0
"""Bits of the point format, of which LAZ sets one."""
_MOST_COMPRESSION = 1000
"""LAZ packs no scan of a LiDAR to less than this share; a header that claims more is damaged."""


@dataclass(frozen=True)
class _Header:
    """Places and lengths in bytes; places are 0 where there is nothing."""

    length: int
    begin: int
    records: int
    point_bytes: int
    points: int
    is_compressed: bool
    waveforms: int
    extended_at: int
    extended_records: int


def check_header(path: Path) -> None:
    """Refuse a file whose header has counts, lengths or places that the file has no room for.

    A remark tells of points after the number that the header says, which are left out.

    Raises
    ------
    InputError
        The file is not LAS, is damaged, or is cut short.
    """
    size = path.stat().st_size
    try:
        with path.open("rb") as stream:
            header = _header(stream.read(max(_HEADER_BYTES.values())))
            _check_places(header, size)
            _check_records(stream, header.length, header.records, header.begin, _RECORD)
            extended = (header.extended_at, header.extended_records)
            _check_records(stream, *extended, size, _EXTENDED_RECORD)
    except ValueError as error:
        raise InputError(f"{path}: not a readable LAS file ({error})") from error
    spare = 0 if header.is_compressed else _spare_points(header, size)
    if spare:
        _LOG.warning(
            "%s: its header says %d points: the %d after them are left out",
            *(path, header.points, spare),
        )


def _header(start: bytes) -> _Header:
    if start[:4] != b"LASF":
        raise ValueError("it does not begin with LASF")
    if len(start) < _HEADER_BYTES[0]:
        raise ValueError("its header is cut short")
    major, minor = start[24:26]
    if major != 1 or minor not in _HEADER_BYTES:
        raise ValueError(f"version {major}.{minor}")
    length, begin, records, kind, point_bytes, points = _STARTS.unpack_from(start, _STARTS_AT)
    if min(length, len(start)) < _HEADER_BYTES[minor]:
        raise ValueError("its header is cut short")
    waveforms, extended_at, extended_records = 0, 0, 0
    if minor >= 3:
        (waveforms,) = _WAVEFORMS.unpack_from(start, _WAVEFORMS_AT)
    if minor >= 4:
        extended_at, extended_records, points = _EXTENDED.unpack_from(start, _EXTENDED_AT)
    is_compressed = bool(kind & _COMPRESSED)
    others = (waveforms, extended_at, extended_records)
    return _Header(length, begin, records, point_bytes, points, is_compressed, *others)


def _check_places(header: _Header, size: int) -> None:
    if not header.length <= header.begin <= size:
        raise ValueError(f"its points begin at byte {header.begin} of {size}")
    if not header.point_bytes:
        raise ValueError("its points have no bytes")
    room = (size - header.begin) // header.point_bytes
    if header.is_compressed:
        room *= _MOST_COMPRESSION
    if header.points > room:
        raise ValueError(f"it is cut short: {header.points} points in its header, room for {room}")


def _check_records(
    stream: BinaryIO, begin: int, count: int, end: int, layout: struct.Struct
) -> None:
    """Refuse records, each with its length in its head, that do not end before byte `end`."""
    if count * layout.size > max(0, end - begin):
        raise ValueError(f"{count} variable length records in {max(0, end - begin)} bytes")
    place = begin
    for _ in range(count):
        stream.seek(place)
        head = stream.read(layout.size)
        place += layout.size
        if place <= end:
            place += layout.unpack(head)[0]
        if place > end:
            raise ValueError("its variable length records are cut short")


def _spare_points(header: _Header, size: int) -> int:
    """Number of whole points between the last one of the header and what follows."""
    end = header.begin + header.points * header.point_bytes
    after = [place for place in (header.waveforms, header.extended_at) if place >= end]
    return int((min([size, *after]) - end) // header.point_bytes)

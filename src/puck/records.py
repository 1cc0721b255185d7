"""Format of streams: a magic number and a version, followed by records.

A record consists of its kind, the length of its body (a base-128 number) and, unless the body is
empty, the CRC-32 and the body.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import IO, NamedTuple, Protocol

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError
from pointkit.files import unreadable
from pointkit.lidar.turns import Layout

MAGIC = b"PUCK"
_VERSION = 3
_CHECKSUM_BYTES = 4
_PORTION = 1 << 20
_START_BYTES = 16
"""Number of bytes at the beginning of a body that tell whether a turn is a key turn, and its size.
"""
_FEW_RANGES, _RANGES_PER_BYTE = 1 << 22, 32
"""Limit of the ranges in a stream: a constant, and more for each byte of the stream.

Coarsely quantised scans without noise have few bits per range.
"""
_SMALL_BYTES, _MANY_RANGES = 1 << 20, 6 << 20
"""A stream of up to 1 MiB holds at most 6 Mi ranges, which is some seconds of a recording."""
_RANGES_PER_TURN = 1024
"""Number of ranges added for each turn, since decoding even two ranges of a key turn takes 1 ms."""
DAMAGED = "the stream is damaged or truncated"


def check(is_valid: bool) -> None:
    """Raise InputError, which says that the stream is damaged, unless `is_valid`."""
    if not is_valid:
        raise InputError(DAMAGED)


class RecordKind(IntEnum):
    """Kind of a record, which says what the record's body contains.

    The kinds are: end of the stream, layout of images, turn, bytes between packets, page links of
    an SQLite file, beams of the sensor, further fields of the last turn's packets, layout of
    clouds, cloud, places of clouds between packets, compressed chunks that were opened, long rows
    of an SQLite file, the file beside the recording that describes the sensor, number of the sensor
    to which the next records belong, and order of the packets of several turns.
    """

    END, LAYOUT, TURN, GAPS, PAGES, BEAMS, FIELDS = range(7)
    CLOUD_LAYOUT, CLOUD, PLACES, CHUNKS, PAYLOADS, METADATA, SENSOR, ORDER = range(7, 15)


@dataclass(frozen=True)
class Record:
    """One record of a stream: its kind, and its body as bytes."""

    kind: RecordKind
    body: bytes

    def packed(self) -> bytes:
        """Return the bytes of the record in a stream: kind, length, checksum and body."""
        return bytes([self.kind]) + base_128(len(self.body)) + _with_checksum(self.kind, self.body)


def _with_checksum(kind: int, body: bytes) -> bytes:
    checksum = zlib.crc32(body, kind).to_bytes(_CHECKSUM_BYTES, "little")
    return checksum + body if body else b""


def start() -> bytes:
    """Return the magic number and the version, with which every stream begins."""
    return MAGIC + bytes([_VERSION])


class Readable(Protocol):
    """Object of which the next bytes can be read, such as a binary file or a pipe."""

    def read(self, size: int, /) -> bytes:
        """Return up to `size` bytes, or none at the end."""


def is_stream(path: Path) -> bool:
    """Return whether a path is a file that begins as streams of any version.

    Raises InputError if the file cannot be read.
    """
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError as error:
        raise unreadable(path, error) from error


def join_records(records: Iterable[Record]) -> bytes:
    """Return a whole stream (bytes): its start, the records, and the END record that ends it."""
    return b"".join([start(), *(each.packed() for each in (*records, Record(RecordKind.END, b"")))])


def read_records(stream: Readable) -> Iterator[Record]:
    """Read a stream, and yield its records up to and including the END record."""
    _check_start(stream)
    while True:
        record = _read_record(stream)
        yield record
        if record.kind == RecordKind.END:
            check(not stream.read(1))
            return


class RecordPlace(NamedTuple):
    """Place of a record in a file: its kind, its position, and the first bytes of its body."""

    kind: RecordKind
    at: int
    start: bytes


def places_of_records(file: IO[bytes]) -> Iterator[RecordPlace]:
    """Find the records of a stream in a seekable file, without reading their bodies.

    The END record is not among them. Checksums are not verified.
    """
    file.seek(0)
    _check_start(file)
    while True:
        at = file.tell()
        kind, length = _read_head(file)
        if kind == RecordKind.END:
            return
        body = file.tell() + (_CHECKSUM_BYTES if length else 0)
        file.seek(body)
        yield RecordPlace(kind, at, file.read(min(length, _START_BYTES)))
        file.seek(body + length)


def read_record(file: IO[bytes], at: int) -> Record:
    """Read the record at a position in a file, as `places_of_records` returns it."""
    file.seek(at)
    return _read_record(file)


def _check_start(stream: Readable) -> None:
    head = read_up_to(stream, len(MAGIC) + 1)
    if head[: len(MAGIC)] != MAGIC:
        raise InputError("not a puck stream")
    if head != start():
        raise InputError("not a puck stream of this version")


def _read_record(stream: Readable) -> Record:
    kind, length = _read_head(stream)
    content = read_up_to(stream, length + _CHECKSUM_BYTES if length else 0)
    body = content[_CHECKSUM_BYTES:]
    check(len(body) == length and content == _with_checksum(kind, body))
    return Record(kind, body)


def _read_head(stream: Readable) -> tuple[RecordKind, int]:
    kind = stream.read(1)
    check(bool(kind) and kind[0] in list(RecordKind))
    length, shift, more = 0, 0, True
    while more:
        byte = stream.read(1)
        check(bool(byte) and shift <= 28)
        length |= (byte[0] & 127) << shift
        shift, more = shift + 7, byte[0] >= 128
    return RecordKind(kind[0]), length


def read_up_to(stream: Readable, length: int) -> bytes:
    """Return the next `length` bytes of a stream, or fewer if it ends before."""
    # A damaged length may be huge: portions keep the memory to what the stream holds.
    parts = []
    while length > 0 and (part := stream.read(min(length, _PORTION))):
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def count_ranges(layout: Layout, body: bytes) -> int:
    """Return the number of ranges of the coded turn `body`, plus `_RANGES_PER_TURN`."""
    reader = Reader(body)
    reader.take(1)
    reader.number()
    columns = reader.number() * layout.columns_per_block
    return columns * layout.lasers * layout.kinds + _RANGES_PER_TURN


def most_ranges(size: int) -> int:
    """Return the largest number of ranges that a decoder accepts in a stream of `size` bytes."""
    few = min(_FEW_RANGES + _RANGES_PER_BYTE * size, _MANY_RANGES)
    return few + _RANGES_PER_BYTE * max(size - _SMALL_BYTES, 0)


def check_ranges(ranges: int, size: int) -> None:
    """Raise InputError if a stream of `size` bytes has more ranges than a decoder accepts."""
    if ranges > most_ranges(size):
        raise InputError(f"{ranges} ranges in {size} bytes: more than they can hold")

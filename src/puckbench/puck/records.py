"""What a stream is made of: a start, then records, each a kind, a length, a check and a body.

A record is a layout, a turn, what lies between packets or in pages (`recording`), the beams of the
sensor (`beams`), or the end.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import IO

from puckbench.coding.byte_io import base_128
from puckbench.core.errors import InputError

MAGIC = b"PUCK"
_VERSION = 1
_CHECK_BYTES = 4
_PORTION = 1 << 20
DAMAGED = "the stream is damaged or truncated"


class Kind(IntEnum):
    """Kinds of records."""

    END, LAYOUT, TURN, GAPS, PAGES, BEAMS = range(6)


@dataclass(frozen=True)
class Record:
    """A record of a stream."""

    kind: Kind
    body: bytes

    def packed(self) -> bytes:
        """The record as bytes."""
        return bytes([self.kind]) + base_128(len(self.body)) + _check(self.kind, self.body)


def _check(kind: int, body: bytes) -> bytes:
    """A body after its check; nothing for nothing."""
    check = zlib.crc32(body, kind).to_bytes(_CHECK_BYTES, "little")
    return check + body if body else b""


def start() -> bytes:
    """What a stream begins with."""
    return MAGIC + bytes([_VERSION])


def stream_of(records: Iterable[Record]) -> bytes:
    """A whole stream of records, which the end follows."""
    return b"".join([start(), *(each.packed() for each in (*records, Record(Kind.END, b"")))])


def read_records(stream: IO[bytes]) -> Iterator[Record]:
    """The records of a stream, the end among them.

    Raises
    ------
    InputError
        It is no such stream, is damaged, or ends before its end.
    """
    found = stream.read(len(MAGIC) + 1)
    if found[: len(MAGIC)] != MAGIC:
        raise InputError("not a puck stream")
    if found != start():
        raise InputError("not a puck stream of this version")
    while True:
        record = _read_record(stream)
        yield record
        if record.kind == Kind.END:
            if stream.read(1):
                raise InputError(DAMAGED)
            return


def _read_record(stream: IO[bytes]) -> Record:
    kind = stream.read(1)
    if not kind or kind[0] not in list(Kind):
        raise InputError(DAMAGED)
    length, shift, more = 0, 0, True
    while more:
        byte = stream.read(1)
        if not byte or shift > 28:
            raise InputError(DAMAGED)
        length |= (byte[0] & 127) << shift
        shift, more = shift + 7, byte[0] >= 128
    checked = _read(stream, length + _CHECK_BYTES if length else 0)
    body = checked[_CHECK_BYTES:]
    if len(body) != length or checked != _check(kind[0], body):
        raise InputError(DAMAGED)
    return Record(Kind(kind[0]), body)


def _read(stream: IO[bytes], length: int) -> bytes:
    """At most `length` bytes, which may be far more than there are."""
    parts = []
    while length > 0 and (part := stream.read(min(length, _PORTION))):
        parts.append(part)
        length -= len(part)
    return b"".join(parts)

"""The stream: a start, then records, each a kind, a length, a check and a body.

A record is a layout, a turn, what lies between packets or in pages (`recording`), the beams of the
sensor (`codec`), or the end.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from io import BytesIO
from typing import IO

from puckbench.codecs.common.byte_io import base_128
from puckbench.codecs.puck.layout import packed, unpacked
from puckbench.codecs.puck.turns import Settings, TurnDecoder, TurnEncoder, is_key
from puckbench.core.errors import InputError
from puckbench.lidar.turns import Layout, Turn

MAGIC = b"PUCK"
_VERSION = 1
_CHECK_BYTES = 4
_PORTION = 1 << 20
_DAMAGED = "the stream is damaged or truncated"


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
                raise InputError(_DAMAGED)
            return


def _read_record(stream: IO[bytes]) -> Record:
    kind = stream.read(1)
    if not kind or kind[0] not in list(Kind):
        raise InputError(_DAMAGED)
    length, shift, more = 0, 0, True
    while more:
        byte = stream.read(1)
        if not byte or shift > 28:
            raise InputError(_DAMAGED)
        length |= (byte[0] & 127) << shift
        shift, more = shift + 7, byte[0] >= 128
    checked = _read(stream, length + _CHECK_BYTES if length else 0)
    body = checked[_CHECK_BYTES:]
    if len(body) != length or checked != _check(kind[0], body):
        raise InputError(_DAMAGED)
    return Record(Kind(kind[0]), body)


def _read(stream: IO[bytes], length: int) -> bytes:
    """At most `length` bytes, which may be far more than there are."""
    parts = []
    while length > 0 and (part := stream.read(min(length, _PORTION))):
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def encode(turns: Iterable[Turn], layout: Layout, settings: Settings | None = None) -> bytes:
    """Code turns as one stream.

    Parameters
    ----------
    turns
        Of one layout, in the order of time.
    layout
        Theirs.
    settings
        What is coded; the defaults are without loss.

    Raises
    ------
    InputError
        A turn has not the layout's shapes.

    Examples
    --------
    >>> import numpy as np
    >>> from puckbench.codecs.puck import Layout, Turn, decode, encode
    >>> ranges = np.full((1, 4, 2), 500, np.uint16)  # one kind, four columns, two lasers
    >>> turn = Turn(ranges, azimuths=np.arange(0, 80, 20, dtype=np.uint16))
    >>> stream = encode([turn, turn], Layout(order=(1, 0)))
    >>> [bool((found.ranges == ranges).all()) for found in decode(stream)]
    [True, True]
    """
    encoder = TurnEncoder(layout, settings)
    records = [Record(Kind.LAYOUT, packed(layout))]
    records += [Record(Kind.TURN, encoder.encode(turn)) for turn in turns]
    return b"".join([start(), *(each.packed() for each in [*records, Record(Kind.END, b"")])])


def decode(stream: bytes, first: int = 0, end: int | None = None) -> list[Turn]:
    """Decode the turns of a stream from number `first` to before `end`.

    Decoding begins at the last key turn that is not after `first`. The turns of a compressed
    recording can be had in the same way.

    Raises
    ------
    InputError
        The stream is damaged, or another codec's.
    """
    layout: Layout | None = None
    waiting: list[tuple[Layout, bytes]] = []
    number = 0
    for record in read_records(BytesIO(stream)):
        if record.kind == Kind.LAYOUT:
            layout = unpacked(record.body)[0]
        elif record.kind == Kind.TURN and (end is None or number < end):
            if layout is None:
                raise InputError(_DAMAGED)
            if is_key(record.body) and number <= first:
                waiting = []
            waiting.append((layout, record.body))
            number += 1
    return _decoded(waiting)[len(waiting) - (number - first) :] if number > first else []


def _decoded(bodies: list[tuple[Layout, bytes]]) -> list[Turn]:
    turns, decoder = [], None
    for layout, body in bodies:
        if decoder is None or decoder.layout != layout:
            decoder = TurnDecoder(layout)
        turns.append(decoder.decode(body))
    return turns

"""Turns of one layout as a stream, and the turns of any stream."""

from __future__ import annotations

from collections.abc import Iterable
from io import BytesIO

from puckbench.coding.byte_io import Reader
from puckbench.core.errors import InputError
from puckbench.lidar.turns import Layout, Turn
from puckbench.puck.layout import packed, unpacked
from puckbench.puck.records import DAMAGED, Kind, Record, read_records, stream_of
from puckbench.puck.turns import Settings, TurnDecoder, TurnEncoder, is_key

_FEW_RANGES, _RANGES_PER_BYTE = 1 << 22, 32
"""Ranges that any stream may hold, and for each byte of it beside them: of scans without noise that
are coded with much loss, which have few bits a range."""
_SMALL, _MANY_RANGES = 1 << 20, 6 << 20
"""Bytes of a small stream, and the most ranges in one: those of some seconds."""
_TURN = 1024
"""Ranges that take as long as a turn without any: a key turn of two returns takes 1 ms."""


def ranges_of(layout: Layout, body: bytes) -> int:
    """Ranges of a coded turn, as its header says, and what a turn costs beside them."""
    reader = Reader(body)
    reader.take(1)
    reader.number()
    return reader.number() * layout.columns_per_block * layout.lasers * layout.kinds + _TURN


def most_ranges(size: int) -> int:
    """Ranges that a stream of `size` bytes may hold, at most."""
    few = min(_FEW_RANGES + _RANGES_PER_BYTE * size, _MANY_RANGES)
    return few + _RANGES_PER_BYTE * max(size - _SMALL, 0)


def check_ranges(ranges: int, size: int) -> None:
    """Refuse more ranges than a stream of `size` bytes may hold, before they are decoded.

    Encoders ask too, so that they write nothing that a decoder refuses.
    """
    if ranges > most_ranges(size):
        raise InputError(f"{ranges} ranges in {size} bytes: more than they may hold")


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
    >>> from puckbench.puck.stream import decode, encode
    >>> from puckbench.lidar.turns import Layout, Turn
    >>> ranges = np.full((1, 4, 2), 500, np.uint16)  # one kind, four columns, two lasers
    >>> turn = Turn(ranges, azimuths=np.arange(0, 80, 20, dtype=np.uint16))
    >>> stream = encode([turn, turn], Layout(order=(1, 0)))
    >>> [bool((found.ranges == ranges).all()) for found in decode(stream)]
    [True, True]
    """
    encoder = TurnEncoder(layout, settings)
    records = [Record(Kind.LAYOUT, packed(layout))]
    records += [Record(Kind.TURN, encoder.encode(turn)) for turn in turns]
    return stream_of(records)


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
                raise InputError(DAMAGED)
            if is_key(record.body) and number <= first:
                waiting = []
            waiting.append((layout, record.body))
            number += 1
    check_ranges(sum(ranges_of(*each) for each in waiting), len(stream))
    return _decoded(waiting)[len(waiting) - (number - first) :] if number > first else []


def _decoded(bodies: list[tuple[Layout, bytes]]) -> list[Turn]:
    turns, decoder = [], None
    for layout, body in bodies:
        if decoder is None or decoder.layout != layout:
            decoder = TurnDecoder(layout)
        turns.append(decoder.decode(body))
    return turns

from __future__ import annotations

from collections.abc import Iterable

from pointkit.coding.byte_io import Reader
from pointkit.errors import InputError
from pointkit.lidar.turns import Layout, Turn
from puck.options import CodingOptions
from puck.records import Record, RecordKind, join_records
from puck.returns_header import encode_layout
from puck.turns import TurnEncoder

_FEW_RANGES, _RANGES_PER_BYTE = 1 << 22, 32
"""Limit of the ranges in a stream: a constant, and more for each byte of the stream.

Coarsely quantised scans without noise have few bits per range.
"""
_SMALL_BYTES, _MANY_RANGES = 1 << 20, 6 << 20
"""A stream of up to 1 MiB holds at most 6 Mi ranges: some seconds of a recording."""
_RANGES_PER_TURN = 1024
"""Ranges added for each turn, since decoding even two ranges of a key turn takes 1 ms."""


def count_ranges(layout: Layout, body: bytes) -> int:
    """Return the number of ranges in a coded turn, plus `_RANGES_PER_TURN`."""
    reader = Reader(body)
    reader.take(1)
    reader.number()
    columns = reader.number() * layout.columns_per_block
    return columns * layout.lasers * layout.kinds + _RANGES_PER_TURN


def most_ranges(size: int) -> int:
    few = min(_FEW_RANGES + _RANGES_PER_BYTE * size, _MANY_RANGES)
    return few + _RANGES_PER_BYTE * max(size - _SMALL_BYTES, 0)


def check_ranges(ranges: int, size: int) -> None:
    """Raise InputError if a stream of `size` bytes has more ranges than it can hold."""
    if ranges > most_ranges(size):
        raise InputError(f"{ranges} ranges in {size} bytes: more than they can hold")


def encode_turns(
    turns: Iterable[Turn], layout: Layout, options: CodingOptions | None = None
) -> bytes:
    """Encode turns of one layout, in chronological order, as one stream without the sensor's beams.

    Raises InputError if the arrays of a turn do not have the layout's shapes.

    Examples
    --------
    >>> import numpy as np
    >>> from puck import decode_turns, encode_turns
    >>> from pointkit.lidar.turns import Layout, Turn
    >>> ranges = np.full((1, 4, 2), 500, np.uint16)  # one return per beam, 4 columns, 2 lasers
    >>> turn = Turn(ranges, azimuths=np.arange(0, 80, 20, dtype=np.uint16))
    >>> stream = encode_turns([turn, turn], Layout(order=(1, 0)))
    >>> [bool((decoded.ranges == ranges).all()) for decoded in decode_turns(stream)]
    [True, True]
    """
    encoder = TurnEncoder(layout, options)
    records = [Record(RecordKind.LAYOUT, encode_layout(layout))]
    records += [Record(RecordKind.TURN, encoder.encode(turn)) for turn in turns]
    return join_records(records)

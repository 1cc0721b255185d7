"""The layout of turns as bytes."""

from __future__ import annotations

from puckbench.coding.byte_io import Reader
from puckbench.core.errors import InputError
from puckbench.lidar.turns import Layout


def packed(layout: Layout) -> bytes:
    """The layout as bytes."""
    sizes = [layout.columns_per_block, layout.blocks_per_time, layout.kinds, layout.lasers]
    return bytes([*sizes, *_paired(layout.order)])


def unpacked(body: bytes) -> tuple[Layout, bytes]:
    """The layout of bytes, and what follows it; InputError when they are damaged."""
    reader = Reader(body)
    *sizes, lasers = reader.take(4)
    try:
        return Layout(_taken(reader, lasers), *sizes), reader.rest()
    except ValueError as error:
        raise InputError(f"the stream is damaged ({error})") from error


def _paired(order: tuple[int, ...]) -> tuple[int, ...]:
    """Up to 16 lasers by two in a byte."""
    if len(order) > 16:
        return order
    even = (*order, 0)[: -(-len(order) // 2) * 2]
    return tuple(even[k] | even[k + 1] << 4 for k in range(0, len(even), 2))


def _taken(reader: Reader, lasers: int) -> tuple[int, ...]:
    """The inverse of `_paired`."""
    if lasers > 16:
        return tuple(reader.take(lasers))
    pairs = reader.take(-(-lasers // 2))
    return tuple(part for pair in pairs for part in (pair & 15, pair >> 4))[:lasers]

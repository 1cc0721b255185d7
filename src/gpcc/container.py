"""Container of a G-PCC stream and its input grid, which G-PCC cannot signal.

    4 bytes   "PBGP"
    1 byte    1 if a grid follows, otherwise 0
    32 bytes  grid, if any: step, and origin x, y, z (float64, little-endian)
    stream

A bare stream, as TMC13 writes it, starts with the payload type 0 and the payload's length in four
bytes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from gpcc.grid import DEFAULT_GRID, InputGrid
from pointkit.errors import InputError

MAGIC = b"PBGP"
_GRID = struct.Struct("<4d")


class Unwrapped(NamedTuple):
    stream: bytes
    grid: InputGrid


def wrap(stream: bytes, grid: InputGrid) -> bytes:
    """Put a bare stream and its grid into a container; the default grid is omitted."""
    if grid == DEFAULT_GRID:
        return MAGIC + b"\0" + stream
    return MAGIC + b"\1" + _GRID.pack(grid.unit, *grid.offset) + stream


def unwrap(data: bytes) -> Unwrapped:
    """Read a container or a bare stream."""
    if not data.startswith(MAGIC):
        if not data.startswith(b"\0\0\0"):
            raise InputError("not a G-PCC stream")
        return Unwrapped(data, DEFAULT_GRID)
    start = len(MAGIC) + 1
    if data[start - 1 : start] == b"\0":
        return Unwrapped(data[start:], DEFAULT_GRID)
    if data[start - 1 : start] != b"\1" or len(data) < start + _GRID.size:
        raise InputError("the stream's first bytes are damaged")
    unit, *offset = _GRID.unpack_from(data, start)
    if not (0 < unit < np.inf and np.isfinite(offset).all()):
        raise InputError("the stream's first bytes are damaged (the grid is not finite)")
    x, y, z = offset
    return Unwrapped(data[start + _GRID.size :], InputGrid(unit, (x, y, z)))

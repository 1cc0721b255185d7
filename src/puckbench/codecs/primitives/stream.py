"""The header of a stream: where the cells lie, how finely planes are coded, how points are filled.

Layout, little endian: magic ``PBPR``, version, kind; then for surfaces the numbers of `_SURFACE`
and the coded bits, for voxels those of `_VOXELS` and G-PCC's tree. The last two bytes are a check.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import numpy as np

from puckbench.cloud import Floats
from puckbench.errors import InputError

MAGIC = b"PBPR"
SURFACE, VOXELS = 1, 2
_START = struct.Struct("<4sB")
_SURFACE = struct.Struct("<4f3HBBBBBBI")
_VOXELS = struct.Struct("<4d")
_CHECK = struct.Struct("<H")
MOST_CELLS = 1 << 26
MOST_LEAVES = 1 << 22
MOST_POINTS = 1 << 24


class Header(NamedTuple):
    """What a surface's stream begins with.

    origin: (3,) of the cells, in the cloud's coordinates. unit: the cell's side there. shape: (3,)
    cells. depth: level of the cells, finest and coarsest those of leaves. step: a plane's precision
    in 1/16 cells at the finest leaves. fineness: points across a cell, spread: cells between
    points; one of them is 1. leaves: room for nodes.
    """

    origin: Floats
    unit: float
    shape: tuple[int, int, int]
    depth: int
    finest: int
    coarsest: int
    step: int
    fineness: int
    spread: int
    leaves: int


def pack_surface(header: Header, bits: bytes) -> bytes:
    """A whole stream from a header and the coded bits."""
    numbers = [*header.origin, header.unit, *header.shape, *header[3:]]
    return _checked(_START.pack(MAGIC, SURFACE) + _SURFACE.pack(*numbers) + bits)


def pack_voxels(origin: Floats, unit: float, bits: bytes) -> bytes:
    """A whole stream of voxels of side `unit` at `origin` (3,)."""
    return _checked(_START.pack(MAGIC, VOXELS) + _VOXELS.pack(*origin, unit) + bits)


def unpack(stream: bytes) -> tuple[Header | tuple[Floats, float], bytes]:
    """Header (or origin and unit of voxels) and the coded bits; InputError for a damaged stream."""
    if len(stream) < _START.size + _CHECK.size or not stream.startswith(MAGIC):
        raise InputError("not a stream of primitives, or truncated")
    body, check = stream[: -_CHECK.size], _CHECK.unpack(stream[-_CHECK.size :])[0]
    kind = _START.unpack_from(body)[1]
    layout = {SURFACE: _SURFACE, VOXELS: _VOXELS}.get(kind)
    if layout is None or len(body) < _START.size + layout.size:
        raise InputError("the stream is truncated or of an unknown kind")
    if zlib.crc32(body) & 0xFFFF != check:
        raise InputError("the stream is damaged or truncated")
    numbers = layout.unpack_from(body, _START.size)
    bits = body[_START.size + layout.size :]
    place = np.array(numbers[:4])
    if not np.isfinite(place).all() or np.abs(place).max() > 1e30 or place[3] <= 0:
        raise InputError("the stream is damaged (its frame is not finite)")
    if kind == VOXELS:
        return (place[:3], float(place[3])), bits
    header = Header(place[:3], float(place[3]), numbers[4:7], *numbers[7:])
    _check(header)
    return header, bits


def _check(header: Header) -> None:
    size = np.array(header.shape, dtype=np.int64)
    fits = size.min() > 0 and size.prod() <= MOST_CELLS and size.max() <= 1 << header.depth
    levels = 0 <= header.coarsest <= header.finest <= header.depth <= 16
    fine = header.depth - header.coarsest <= 8 or header.coarsest == 0
    points = 1 <= header.fineness <= 16 and 1 <= header.spread <= 64 and header.step > 0
    if not (fits and levels and points and fine) or header.leaves > MOST_LEAVES:
        raise InputError("the stream is damaged (its header makes no sense)")


def _checked(body: bytes) -> bytes:
    return body + _CHECK.pack(zlib.crc32(body) & 0xFFFF)

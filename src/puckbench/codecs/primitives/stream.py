"""The header of a stream: where the cells lie, how finely planes are coded, how points are filled.

Layout, little endian: magic ``PBPR``, version, kind; then for surfaces the numbers of `_SURFACE`,
those of `_TURN` if they are turned, number and parameters of round surfaces if there are any, and
the coded bits, for voxels those of `_VOXELS`, a table of
`BINS` bytes unless the side of its blocks is 0, and G-PCC's tree. The last two bytes are a check.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives.manhattan_frame import Turn, rotation
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

MAGIC = b"PBPR"
VERSION = 3
SURFACE, VOXELS, TURNED, WITH_ROUNDS = 1, 2, 4, 8
"""Kinds of streams; those of surfaces may be turned and have round surfaces."""
ROUND = 19
"""Bytes of a round surface's parameters."""
_START = struct.Struct("<4sBB")
_SURFACE = struct.Struct("<4f3HBBBBBBI")
_TURN = struct.Struct("<3h")
_VOXELS = struct.Struct("<4fB")
_CHECK = struct.Struct("<H")
MOST_CELLS = 1 << 26
MOST_LEAVES = 1 << 22
MOST_POINTS = 1 << 24
MOST_ROUND_POINTS = 1 << 22


BLOCKS = (1, 2, 4)
"""Sides of the blocks, in voxels, that share a plane: that of 3 x 3 x 3 blocks around."""
BINS = 24
"""Classes of voxels that move alike."""


class Place(NamedTuple):
    """Where whole numbers lie: origin (3,) and what one is, in the cloud's coordinates."""

    origin: Floats
    unit: float

    def rounded(self) -> Place:
        """As it comes back from a stream."""
        origin = self.origin.astype(np.float32).astype(np.float64)
        return Place(origin, float(np.float32(self.unit)))


class Table(NamedTuple):
    """How voxels move: side of a block, and the share of the distance for each class, in 1/64."""

    block: int
    shares: NDArray[np.int8]


class Voxels(NamedTuple):
    """What a stream of voxels begins with."""

    place: Place
    table: Table | None


class Header(NamedTuple):
    """What a surface's stream begins with.

    origin: (3,) of the cells, in the cloud's coordinates. unit: the cell's side there. shape: (3,)
    cells. depth: level of the cells, finest and coarsest those of leaves. step: a plane's precision
    in 1/16 cells at the finest leaves. fineness: points across a cell, spread: cells between
    points; one of them is 1. leaves: room for nodes. turn: from the cloud's axes to those of the
    cells (`axes`), about the cloud's origin. rounds: `ROUND` bytes for each round surface.
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
    turn: Turn = (0, 0, 0)
    rounds: bytes = b""

    def in_cloud(self, cells: Floats) -> Floats:
        """Places (n, 3) in cells in the cloud's coordinates."""
        return np.asarray((cells * self.unit + self.origin) @ rotation(self.turn))


def pack_surface(header: Header, bits: bytes) -> bytes:
    """A whole stream from a header and the coded bits."""
    turned, rounds = any(header.turn), header.rounds
    kind = SURFACE | (TURNED if turned else 0) | (WITH_ROUNDS if rounds else 0)
    head = _START.pack(MAGIC, VERSION, kind)
    head += _SURFACE.pack(*header.origin, header.unit, *header.shape, *header[3:-2])
    head += _TURN.pack(*header.turn) if turned else b""
    head += bytes([len(rounds) // ROUND]) + rounds if rounds else b""
    return _checked(head + bits)


def pack_voxels(place: Place, table: Table | None, bits: bytes) -> bytes:
    """A whole stream of voxels from G-PCC's tree of them and a table of how they move."""
    head = _START.pack(MAGIC, VERSION, VOXELS)
    head += _VOXELS.pack(*place.origin, place.unit, table.block if table else 0)
    return _checked(head + (table.shares.tobytes() if table else b"") + bits)


def unpack(stream: bytes) -> tuple[Header | Voxels, bytes]:
    """What a stream begins with and the coded bits; InputError for a damaged stream."""
    if len(stream) < _START.size + _CHECK.size or not stream.startswith(MAGIC):
        raise InputError("not a stream of primitives, or truncated")
    body, check = stream[: -_CHECK.size], _CHECK.unpack(stream[-_CHECK.size :])[0]
    _, version, kind = _START.unpack_from(body)
    if version != VERSION:
        raise InputError(f"the stream has version {version}, this codec reads {VERSION}")
    layout = _VOXELS if kind == VOXELS else _SURFACE
    known = kind == VOXELS or kind | TURNED | WITH_ROUNDS == SURFACE | TURNED | WITH_ROUNDS
    if not known or len(body) < _START.size + layout.size:
        raise InputError("the stream is truncated or of an unknown kind")
    if zlib.crc32(body) & 0xFFFF != check:
        raise InputError("the stream is damaged or truncated")
    numbers = layout.unpack_from(body, _START.size)
    bits = body[_START.size + layout.size :]
    place = np.array(numbers[:4])
    if not np.isfinite(place).all() or np.abs(place).max() > 1e30 or place[3] <= 0:
        raise InputError("the stream is damaged (its frame is not finite)")
    if kind == VOXELS:
        return _voxels(Place(place[:3], float(place[3])), numbers[4], bits)
    header = Header(place[:3], float(place[3]), numbers[4:7], *numbers[7:])
    _check(header)
    return _with_extras(header, kind, bits)


def _with_extras(header: Header, kind: int, bits: bytes) -> tuple[Header, bytes]:
    """The header with turn and round surfaces, where the kind has them, and what follows."""
    if kind & TURNED:
        if len(bits) < _TURN.size:
            raise InputError("the stream is truncated")
        header = header._replace(turn=_TURN.unpack_from(bits))
        bits = bits[_TURN.size :]
    if kind & WITH_ROUNDS:
        end = 1 + ROUND * bits[0] if bits else 1
        if len(bits) < end:
            raise InputError("the stream is truncated")
        header = header._replace(rounds=bits[1:end])
        bits = bits[end:]
    return header, bits


def _voxels(place: Place, block: int, bits: bytes) -> tuple[Voxels, bytes]:
    if block == 0:
        return Voxels(place, None), bits
    if block not in BLOCKS or len(bits) < BINS:
        raise InputError("the stream is damaged (its table makes no sense)")
    shares = np.frombuffer(bits[:BINS], np.int8)
    return Voxels(place, Table(block, shares)), bits[BINS:]


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

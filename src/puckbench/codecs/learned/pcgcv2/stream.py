"""The bytes of a PCGCv2 stream: which weights made it, counts per scale, coordinates, features.

magic "PCG2", version, kind, CRC-32 of all that follows
kind 0, a cloud too small for a network: its points, three little-endian doubles each
kind 1: digest of the weights (8 bytes), number of the rate among theirs, quarters of a
    halving of the grid, rules (1: families, 2: contexts), points of each voxel in 256ths (2 bytes;
    0: one in its middle); base-128 numbers: origin (signed), number of blocks; each block: voxels
    at strides 1, 2, 4 and 8, bytes of coordinates and of features, these
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntFlag

import numpy as np

from puckbench.codecs.common.byte_io import Reader, base_128, signed_128
from puckbench.codecs.learned.codec import MOST_QUARTERS
from puckbench.codecs.learned.point_reconstruction import check_filling
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

MAGIC = b"PCG2"
VERSION = 6
MOST_VOXELS = 2**20
"""Most voxels of a block, at any scale; more are coded as several blocks."""
_FEW, _NETWORK = 0, 1
_START = struct.Struct("<4sBBI")
_HEADER = struct.Struct("<8sBBBH")


@dataclass(frozen=True)
class Block:
    """Part of a cloud: counts at strides 1, 2, 4, 8; coordinates at stride 8; the latent."""

    counts: tuple[int, int, int, int]
    coordinates: bytes
    features: bytes


class Rules(IntFlag):
    """Where a stream differs from the authors' program."""

    FAMILIES = 1
    """Each voxel keeps its likeliest child at least; in the original it may lose all of them."""
    CONTEXTS = 2
    """The latent is coded in contexts, not with the weights' tables alone."""


OURS = Rules.FAMILIES | Rules.CONTEXTS


@dataclass(frozen=True)
class Coded:
    """A cloud coded by a network.

    origin: voxel that is subtracted from all others. quarters: of a halving of the grid, see
    `puckbench.codecs.learned.grid_level`. per_voxel: its points, in 256ths; 0 for its middle.
    """

    digest: bytes
    rate: int
    origin: tuple[int, int, int]
    blocks: tuple[Block, ...]
    quarters: int = 0
    rules: Rules = OURS
    per_voxel: int = 0

    @property
    def voxels(self) -> int:
        """How many there are."""
        return sum(block.counts[0] for block in self.blocks)


def write_few(points: Floats) -> bytes:
    """The stream of a cloud (n, 3) that is too small for a network."""
    return _framed(_FEW, points.astype("<f8").tobytes())


def write_coded(coded: Coded) -> bytes:
    """The stream of a coded cloud."""
    numbers = (coded.rate, coded.quarters, coded.rules, coded.per_voxel)
    parts = [_HEADER.pack(coded.digest, *numbers)]
    parts += [*map(signed_128, coded.origin), base_128(len(coded.blocks))]
    for block in coded.blocks:
        sizes = (len(block.coordinates), len(block.features))
        parts += [*map(base_128, (*block.counts, *sizes)), block.coordinates, block.features]
    return _framed(_NETWORK, b"".join(parts))


def _framed(kind: int, body: bytes) -> bytes:
    return _START.pack(MAGIC, VERSION, kind, zlib.crc32(body)) + body


def read_stream(stream: bytes) -> Coded | Floats:
    """A coded cloud, or the points of a small one; InputError for any other bytes.

    What the counts promise is held against the size of the stream before anybody works on it.
    """
    if len(stream) < _START.size:
        raise InputError("the stream is truncated")
    magic, version, kind, check = _START.unpack_from(stream)
    if magic != MAGIC or version != VERSION:
        raise InputError("not a PCGCv2 stream of this version")
    body = stream[_START.size :]
    if zlib.crc32(body) != check:
        raise InputError("the stream is damaged or truncated")
    return _read_few(body) if kind == _FEW else _read_coded(body)


def _read_few(body: bytes) -> Floats:
    if not body or len(body) % 24:
        raise InputError("the stream is damaged (points)")
    points = np.frombuffer(body, dtype="<f8").reshape(-1, 3).astype(np.float64)
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (points)")
    return points


def _read_coded(body: bytes) -> Coded:
    reader = Reader(body)
    digest, rate, quarters, rules, per_voxel = _HEADER.unpack(reader.take(_HEADER.size))
    if quarters > MOST_QUARTERS or rules > OURS:
        raise InputError("the stream is damaged (its header)")
    origin = (reader.signed(), reader.signed(), reader.signed())
    blocks = tuple(_read_block(reader) for _ in range(min(reader.number(), len(body))))
    if reader.at != len(body) or not blocks:
        raise InputError("the stream is damaged (its length)")
    coded = Coded(digest, rate, origin, blocks, quarters, Rules(rules), per_voxel)
    if coded.voxels > _most_voxels(body):
        raise InputError("the stream is damaged (it promises too many voxels)")
    check_filling(per_voxel, coded.voxels)
    return coded


def _most_voxels(body: bytes) -> int:
    """Largest believable count: a damaged stream must not keep the decoder busy for long."""
    return 65536 + 8192 * len(body)


def _read_block(reader: Reader) -> Block:
    fine, two, four, eight, coordinates, features = (reader.number() for _ in range(6))
    counts = (fine, two, four, eight)
    _check_counts(counts)
    return Block(counts, reader.take(coordinates), reader.take(features))


def _check_counts(counts: tuple[int, int, int, int]) -> None:
    """Every voxel has at least one child and at most eight (the last scale may have fewer)."""
    fine, two, four, eight = counts
    fits = 1 <= eight <= four <= 8 * eight and four <= two <= 8 * four and 1 <= fine <= 8 * two
    if not fits or max(counts) > 2 * MOST_VOXELS:
        raise InputError("the stream is damaged (counts per scale)")

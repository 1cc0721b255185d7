"""The bytes of a PCGCv1 stream: which weights made it, where its cubes are, what is in them.

magic "PCG1", version, CRC-32 of all that follows
digest of the weights (8 bytes), number of the rate among theirs, scale (double)
whether the latent is coded in contexts (1 byte)
points of each voxel, in 256ths, or 0 for one in its middle (2 bytes)
base-128 numbers: bytes of positions, of counts, of sparse voxels and of the latent, number of cubes
positions of the cubes, or of their blocks that hold voxels if the weights are `supported` (octree),
    voxels to keep in each cube, voxels of sparse cubes (octree), the latent
each block: check of the chosen tables (uint32), base-128 bytes of hyper-latents, these
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from puckbench.codecs.common.byte_io import Reader, base_128
from puckbench.core.errors import InputError

MAGIC = b"PCG1"
VERSION = 4
BLOCK = 32
"""Cubes of a block; the last one may have fewer."""
_SCALES = (2.0**-400, 2.0**16)
"""What a scale is between; with a smaller one coordinates could exceed double precision."""
_START = struct.Struct("<4sBI")
_HEADER = struct.Struct("<8sBdBH")
_CHECK = struct.Struct("<I")


@dataclass(frozen=True)
class Block:
    """Up to `BLOCK` cubes. check: of the tables that the hyper-latents chose for the latents."""

    check: int
    hyper: bytes


@dataclass(frozen=True)
class Coded:
    """A cloud coded by a network.

    scale: voxels per unit. contexts: the latent is coded in them. per_voxel: its points, in
    256ths; 0 for its middle. sparse: voxels coded without a network.
    """

    digest: bytes
    rate: int
    scale: float
    cubes: int
    contexts: bool
    per_voxel: int
    positions: bytes
    counts: bytes
    sparse: bytes
    latent: bytes
    blocks: tuple[Block, ...]


def write_stream(coded: Coded) -> bytes:
    """The stream of a coded cloud; InputError when its cubes are too many for its size."""
    parts = (coded.positions, coded.counts, coded.sparse, coded.latent)
    numbers = [*map(len, parts), coded.cubes]
    body = _HEADER.pack(coded.digest, coded.rate, coded.scale, coded.contexts, coded.per_voxel)
    body += b"".join(map(base_128, numbers)) + b"".join(parts)
    body += b"".join(map(_written, coded.blocks))
    if coded.cubes > _most_cubes(body):
        raise InputError("too many cubes with too little in them")
    return _START.pack(MAGIC, VERSION, zlib.crc32(body)) + body


def _written(block: Block) -> bytes:
    return _CHECK.pack(block.check) + base_128(len(block.hyper)) + block.hyper


def _most_cubes(body: bytes) -> int:
    """A cube is at least a second's tenth of work: a damaged stream must not promise many."""
    return 64 + len(body)


def read_stream(stream: bytes) -> Coded:
    """A coded cloud; InputError for any other bytes.

    The number of cubes is held against the size of the stream before anybody works on it.
    """
    if len(stream) < _START.size:
        raise InputError("the stream is truncated")
    magic, version, check = _START.unpack_from(stream)
    if magic != MAGIC or version != VERSION:
        raise InputError("not a PCGCv1 stream of this version")
    body = stream[_START.size :]
    if zlib.crc32(body) != check:
        raise InputError("the stream is damaged or truncated")
    return _read_body(Reader(body))


def _read_body(reader: Reader) -> Coded:
    digest, rate, scale, contexts, per_voxel = _HEADER.unpack(reader.take(_HEADER.size))
    *sizes, cubes = (reader.number() for _ in range(5))
    fits = contexts <= 1 and _SCALES[0] < scale < _SCALES[1]
    if cubes > _most_cubes(reader.body) or not fits:
        raise InputError("the stream is damaged (its header)")
    positions, counts, sparse, latent = (reader.take(size) for size in sizes)
    blocks = tuple(_read_block(reader) for _ in range(-(-cubes // BLOCK)))
    if reader.at != len(reader.body):
        raise InputError("the stream is damaged (its length)")
    return Coded(digest, rate, scale, cubes, bool(contexts), per_voxel, positions, counts, sparse,
                 latent, blocks)  # fmt: skip


def _read_block(reader: Reader) -> Block:
    check = _CHECK.unpack(reader.take(_CHECK.size))[0]
    return Block(check, reader.take(reader.number()))

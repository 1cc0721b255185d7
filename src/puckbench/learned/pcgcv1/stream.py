"""The stream of PCGCv1: identity of the weights, positions of cubes, voxel counts, latents.

magic "PCG1", version, CRC-32 of all that follows
digest of the weights (8 bytes), number of the rate among theirs, scale (double)
whether the latent is coded with context mixing (1 byte)
points of each voxel, in 256ths, or 0 for one in its centre (2 bytes)
base-128 numbers: bytes of positions, of counts, of sparse voxels and of the latent, number of cubes
positions of the cubes, or of their occupied blocks if the weights were trained with these (octree),
    voxels to keep in each cube, voxels of sparse cubes (octree), the latent
each batch of cubes: check sum of the tables of the latent (uint32), base-128 number of bytes of the
    hyper-latents, these
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from puckbench.coding.byte_io import Reader, base_128
from puckbench.coding.framing import Framing
from puckbench.core.errors import InputError

MAGIC = b"PCG1"
VERSION = 4
BATCH = 32
"""Cubes of a batch; the last one may have fewer."""
_SCALES = (2.0**-400, 2.0**16)
"""Bounds of a scale; with a smaller one coordinates could exceed double precision."""
_VOXELS, _VOXELS_PER_BYTE = 3 * 2**20, 2**13
"""Voxels of all cubes, at most and for each byte: 12 cubes of 64, which take some 3 s, and one more
for 32 bytes; those of scans have more than 140 bytes."""
_KEPT, _KEPT_PER_BYTE = 2**19, 2**10
_SPARSE, _SPARSE_PER_BYTE = 2**16, 16
_FRAMING = Framing(MAGIC, VERSION, "PCGCv1")
_HEADER = struct.Struct("<8sBdBH")
_CHECK = struct.Struct("<I")


@dataclass(frozen=True)
class CubeBatch:
    """Up to `BATCH` cubes: check sum of the tables of their latents, and their hyper-latents."""

    check: int
    hyper: bytes


@dataclass(frozen=True)
class Pcgcv1Stream:
    """A cloud coded by the network.

    Parameters
    ----------
    digest
        Identity of the weights.
    rate
        Index of the rate among those of the weights.
    scale
        Voxels of a unit.
    cubes
        Cubes that the network coded.
    context_mixing
        Whether the latent is coded so.
    points_per_voxel
        In 256ths; 0 for one point in the centre of each voxel.
    positions
        Of cubes or occupied blocks.
    counts
        Voxels to keep in each cube.
    sparse
        Voxels coded without the network.
    latent
        y_hat of all cubes.
    batches
        Hyper-latents.
    """

    digest: bytes
    rate: int
    scale: float
    cubes: int
    context_mixing: bool
    points_per_voxel: int
    positions: bytes
    counts: bytes
    sparse: bytes
    latent: bytes
    batches: tuple[CubeBatch, ...]


def write_stream(coded: Pcgcv1Stream) -> bytes:
    """The stream of a coded cloud; InputError when its cubes are too many for its size."""
    parts = (coded.positions, coded.counts, coded.sparse, coded.latent)
    numbers = [*map(len, parts), coded.cubes]
    body = _HEADER.pack(
        coded.digest, coded.rate, coded.scale, coded.context_mixing, coded.points_per_voxel
    )
    body += b"".join(map(base_128, numbers)) + b"".join(parts)
    body += b"".join(map(_batch_bytes, coded.batches))
    if coded.cubes > _max_cubes(body):
        raise InputError("too many cubes with too little in them")
    return _FRAMING.framed(body)


def _batch_bytes(batch: CubeBatch) -> bytes:
    return _CHECK.pack(batch.check) + base_128(len(batch.hyper)) + batch.hyper


def _max_cubes(body: bytes) -> int:
    """A cube takes a quarter of a second: a damaged stream must not promise many."""
    return 64 + len(body)


def check_work(coded: Pcgcv1Stream, side: int, kept: int) -> None:
    """InputError for cubes, of a side in voxels, that would keep a decoder busy for too long.

    kept: voxels of all cubes that are decoded.
    """
    size = len(coded.positions) + len(coded.counts) + len(coded.latent)
    size += sum(len(batch.hyper) for batch in coded.batches)
    if coded.cubes * side**3 > _VOXELS + _VOXELS_PER_BYTE * size:
        raise InputError(f"{coded.cubes} cubes are too many for {size} bytes")
    if kept > _KEPT + _KEPT_PER_BYTE * size:
        raise InputError(f"{kept} voxels are too many for {size} bytes")


def max_sparse(coded: Pcgcv1Stream) -> int:
    """Voxels coded without the network, at most; in sparse cubes one takes more than half a bit."""
    return min(_SPARSE + _SPARSE_PER_BYTE * len(coded.sparse), 2**21)


def read_stream(stream: bytes) -> Pcgcv1Stream:
    """Parse a stream; the number of cubes is checked against its size before any work begins.

    Raises
    ------
    InputError
        The bytes are damaged, or of another codec or version.
    """
    _, body = _FRAMING.unframed(stream)
    return _read_body(Reader(body))


def _read_body(reader: Reader) -> Pcgcv1Stream:
    digest, rate, scale, context_mixing, points_per_voxel = _HEADER.unpack(
        reader.take(_HEADER.size)
    )
    *sizes, cubes = (reader.number() for _ in range(5))
    fits = context_mixing <= 1 and _SCALES[0] < scale < _SCALES[1]
    if cubes > _max_cubes(reader.body) or not fits:
        raise InputError("the stream is damaged (its header)")
    positions, counts, sparse, latent = (reader.take(size) for size in sizes)
    batches = tuple(_read_batch(reader) for _ in range(-(-cubes // BATCH)))
    if reader.at != len(reader.body):
        raise InputError("the stream is damaged (its length)")
    return Pcgcv1Stream(
        digest, rate, scale, cubes, bool(context_mixing), points_per_voxel, positions, counts,
        sparse, latent, batches,
    )  # fmt: skip


def _read_batch(reader: Reader) -> CubeBatch:
    check = _CHECK.unpack(reader.take(_CHECK.size))[0]
    return CubeBatch(check, reader.take(reader.number()))

"""The stream of PCGCv1, which contains in this order:

* magic "PCG1", version, CRC-32 of the rest
* digest of the weights (8 bytes), index of the rate, scale (double), whether context mixing codes
  the latent (1 byte), points per voxel in 256ths (2 bytes; 0 means one point in the centre)
* base-128 numbers: lengths in bytes of positions, counts, sparse voxels and latent; number of cubes
* positions: octree of the cubes, or of occupied blocks if the weights were trained with such blocks
* counts: number of voxels to keep in each cube
* sparse voxels: octree of the voxels in cubes that the network does not code
* latent
* for each batch of cubes: CRC-32 of the frequency tables of the latent, length of the hyper-latents
  in bytes (base-128), hyper-latents
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.framing import Framing
from pointkit.errors import InputError

MAGIC = b"PCG1"
VERSION = 4
BATCH = 32
"""Cubes of a batch; the last batch may have fewer."""
_SCALES = (2.0**-400, 2.0**16)
"""Bounds of the scale; with smaller scales, coordinates could overflow."""
_VOXELS, _VOXELS_PER_BYTE = 3 * 2**20, 2**13
"""Maximum voxels of all cubes, and additional voxels per byte: 12 cubes of side 64, which take
about 3 s, and one more cube per 32 bytes. Cubes of scans take more than 140 bytes each."""
_KEPT, _KEPT_PER_BYTE = 2**19, 2**10
_SPARSE, _SPARSE_PER_BYTE = 2**16, 16
_FRAMING = Framing(MAGIC, VERSION, "PCGCv1")
_HEADER = struct.Struct("<8sBdBH")
_CHECK = struct.Struct("<I")


@dataclass(frozen=True)
class CubeBatch:
    """The coded hyper-latents of a batch of cubes."""

    check: int  # CRC-32 of the tables of the latent
    hyper: bytes  # coded z_hat


@dataclass(frozen=True)
class Pcgcv1Stream:
    """The numbers in the header of a PCGCv1 stream, and its parts, which are still encoded."""

    digest: bytes  # of the weights
    rate: int  # index among those of the weights
    scale: float  # voxels per step of the input
    cubes: int  # number of cubes that the network coded
    context_mixing: bool
    points_per_voxel: int  # in 256ths; 0 for one point in the centre
    positions: bytes  # of cubes or occupied blocks
    counts: bytes  # voxels to keep in each cube
    sparse: bytes  # voxels coded without the network
    latent: bytes  # y_hat of all cubes
    batches: tuple[CubeBatch, ...]


def write_stream(content: Pcgcv1Stream) -> bytes:
    """Return the bytes of a stream.

    Raises InputError if there are more cubes than a decoder accepts for so few bytes.
    """
    parts = (content.positions, content.counts, content.sparse, content.latent)
    numbers = [*map(len, parts), content.cubes]
    body = _HEADER.pack(
        content.digest,
        content.rate,
        content.scale,
        content.context_mixing,
        content.points_per_voxel,
    )
    body += b"".join(map(base_128, numbers)) + b"".join(parts)
    body += b"".join(map(_batch_bytes, content.batches))
    if content.cubes > _max_cubes(body):
        raise InputError("too many cubes")
    return _FRAMING.framed(body)


def _batch_bytes(batch: CubeBatch) -> bytes:
    return _CHECK.pack(batch.check) + base_128(len(batch.hyper)) + batch.hyper


def _max_cubes(body: bytes) -> int:
    return 64 + len(body)  # the network takes a quarter of a second for each


def check_work(content: Pcgcv1Stream, side: int, decoded_voxels: int) -> None:
    """Raise InputError if decoding would take too long for the size of a stream.

    Parameters
    ----------
    content
        The stream.
    side
        Number of voxels along an edge of a cube.
    decoded_voxels
        Number of voxels that the decoder keeps.
    """
    size = len(content.positions) + len(content.counts) + len(content.latent)
    size += sum(len(batch.hyper) for batch in content.batches)
    if content.cubes * side**3 > _VOXELS + _VOXELS_PER_BYTE * size:
        raise InputError(f"{content.cubes} cubes are too many for {size} bytes")
    if decoded_voxels > _KEPT + _KEPT_PER_BYTE * size:
        raise InputError(f"{decoded_voxels} voxels are too many for {size} bytes")


def max_sparse(content: Pcgcv1Stream) -> int:
    """Return the maximum number of losslessly coded voxels that a decoder accepts."""
    return min(_SPARSE + _SPARSE_PER_BYTE * len(content.sparse), 2**21)


def read_stream(stream: bytes) -> Pcgcv1Stream:
    """Divide a stream into its header and its parts, without decoding the parts.

    Raises
    ------
    InputError
        If the stream is damaged, or of another codec or version.
    """
    reader = Reader(_FRAMING.unframed(stream)[1])
    digest, rate, scale, context_mixing, points_per_voxel = _HEADER.unpack(
        reader.take(_HEADER.size)
    )
    *sizes, cubes = (reader.number() for _ in range(5))
    is_possible = context_mixing <= 1 and _SCALES[0] < scale < _SCALES[1]
    if cubes > _max_cubes(reader.body) or not is_possible:
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

"""The stream of PCGCv2, which contains in this order:

* magic "PCG2", version, kind, CRC-32 of the rest
* if the kind is 0 (a cloud too small for a network): three little-endian doubles for each point
* if the kind is 1: digest of the weights (8 bytes), index of the rate, grid level in quarter
  octaves, coding tools (see `CodingTools`), points per voxel in 256ths (2 bytes; 0 means one point
  in the centre); base-128 numbers: origin (3, signed), number of blocks
* for each block of kind 1: base-128 numbers of voxels at strides 1, 2, 4 and 8; base-128 lengths in
  bytes of coordinates and latent; coordinates; latent
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntFlag

import numpy as np

from pcc_networks.grid_level import MAX_QUARTER_OCTAVES
from pcc_networks.point_reconstruction import check_points_per_voxel
from pointkit.coding.byte_io import Reader, base_128, signed_128
from pointkit.coding.framing import Framing
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

MAGIC = b"PCG2"
VERSION = 6
MAX_VOXELS = 2**20
"""Maximum voxels of a block at any scale; larger clouds are coded as several blocks."""
MAX_BLOCKS = 64
_RAW, _NETWORK = 0, 1
_COARSE, _COARSE_PER_BYTE = 2**16, 2**8
"""Maximum voxels at strides 2, 4 and 8, and additional voxels per byte of the stream. The network
takes about 40 microseconds per voxel; scans have at most about 60 voxels per byte."""
_FRAMING = Framing(MAGIC, VERSION, "PCGCv2", header=1)
_HEADER = struct.Struct("<8sBBBH")


@dataclass(frozen=True)
class CodedBlock:
    """A block of voxels that was encoded separately."""

    counts: tuple[int, int, int, int]  # voxels at strides 1, 2, 4 and 8
    coordinates: bytes  # voxels at stride 8, coded losslessly
    latent: bytes  # coded y_hat


class CodingTools(IntFlag):
    """Coding tools of PCGCv2 that the authors' program does not have."""

    CHILD_PER_PARENT = 1
    """Each voxel keeps at least its most likely child. Without this tool, it may keep none."""
    CONTEXT_MIXING = 2
    """Adaptive contexts are mixed with the entropy bottleneck's tables to code the latent."""


ALL_TOOLS = CodingTools.CHILD_PER_PARENT | CodingTools.CONTEXT_MIXING


@dataclass(frozen=True)
class Pcgcv2Stream:
    """The numbers in the header of a PCGCv2 stream, and its blocks, which are still encoded."""

    digest: bytes  # of the weights
    rate: int  # index among those of the weights
    origin: tuple[int, int, int]  # voxel that was subtracted
    blocks: tuple[CodedBlock, ...]
    quarter_octaves: int = 0
    tools: CodingTools = ALL_TOOLS
    points_per_voxel: int = 0  # in 256ths; 0 for one point in the centre

    @property
    def voxels(self) -> int:
        """Number of decoded voxels."""
        return sum(block.counts[0] for block in self.blocks)


def write_raw(points: Floats) -> bytes:
    """Return the bytes of a stream that stores points (n, 3) without a network."""
    return _FRAMING.framed(points.astype("<f8").tobytes(), bytes([_RAW]))


def write_coded(coded: Pcgcv2Stream) -> bytes:
    """Return the bytes of a stream.

    Raises InputError if there are more voxels or blocks than a decoder accepts for so few bytes.
    """
    numbers = (coded.rate, coded.quarter_octaves, coded.tools, coded.points_per_voxel)
    parts = [_HEADER.pack(coded.digest, *numbers)]
    parts += [*map(signed_128, coded.origin), base_128(len(coded.blocks))]
    for block in coded.blocks:
        sizes = (len(block.coordinates), len(block.latent))
        parts += [*map(base_128, (*block.counts, *sizes)), block.coordinates, block.latent]
    body = b"".join(parts)
    _check_work(coded, body)
    return _FRAMING.framed(body, bytes([_NETWORK]))


def read_stream(stream: bytes) -> Pcgcv2Stream | Floats:
    """Divide a stream into its header and its blocks, without decoding the blocks.

    Returns
    -------
    Pcgcv2Stream or ndarray
        The contents of the stream; or points (n, 3), if the cloud was too small for the network.

    Raises
    ------
    InputError
        If the stream is damaged, or of another codec or version.
    """
    kind, body = _FRAMING.unframed(stream)
    return _read_raw(body) if kind[0] == _RAW else _read_coded(body)


def _read_raw(body: bytes) -> Floats:
    if not body or len(body) % 24:
        raise InputError("the stream is damaged (points)")
    points = np.frombuffer(body, dtype="<f8").reshape(-1, 3).astype(np.float64)
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (points)")
    return points


def _read_coded(body: bytes) -> Pcgcv2Stream:
    reader = Reader(body)
    header = _HEADER.unpack(reader.take(_HEADER.size))
    digest, rate, quarter_octaves, tools, points_per_voxel = header
    if quarter_octaves > MAX_QUARTER_OCTAVES or tools > ALL_TOOLS:
        raise InputError("the stream is damaged (its header)")
    origin = (reader.signed(), reader.signed(), reader.signed())
    blocks = tuple(_read_block(reader) for _ in range(min(reader.number(), MAX_BLOCKS)))
    if reader.at != len(body) or not blocks:
        raise InputError("the stream is damaged (its length)")
    coded = Pcgcv2Stream(
        digest, rate, origin, blocks, quarter_octaves, CodingTools(tools), points_per_voxel
    )
    _check_work(coded, body)
    check_points_per_voxel(points_per_voxel, coded.voxels)
    return coded


def _check_work(coded: Pcgcv2Stream, body: bytes) -> None:
    coarse = sum(sum(block.counts[1:]) for block in coded.blocks)
    if (
        coded.voxels > 65536 + 8192 * len(body)
        or coarse > _COARSE + _COARSE_PER_BYTE * len(body)
        or len(coded.blocks) > MAX_BLOCKS
    ):
        raise InputError(f"too many voxels for a stream of {len(body)} bytes")


def _read_block(reader: Reader) -> CodedBlock:
    stride_1, stride_2, stride_4, stride_8, coordinates, latent = (
        reader.number() for _ in range(6)
    )
    counts = (stride_1, stride_2, stride_4, stride_8)
    _check_counts(counts)
    return CodedBlock(counts, reader.take(coordinates), reader.take(latent))


def _check_counts(counts: tuple[int, int, int, int]) -> None:
    """Raise InputError if the numbers of voxels at strides 1, 2, 4 and 8 are impossible."""
    stride_1, stride_2, stride_4, stride_8 = counts
    is_possible = (
        1 <= stride_8 <= stride_4 <= 8 * stride_8
        and stride_4 <= stride_2 <= 8 * stride_4
        and 1 <= stride_1 <= 8 * stride_2
    )
    if not is_possible or max(counts) > 2 * MAX_VOXELS:
        raise InputError("the stream is damaged (counts per scale)")

"""Bitstream of the primitives codec: headers of surfaces and of voxels, packed and checked.

Little endian: magic ``PBPR``, version, kind. A surface goes on with the numbers of `_SURFACE`,
those of `_ROTATION` if the grid is rotated, number and parameters of the surfaces of revolution if
there are any, and the arithmetic-coded bits. Voxels go on with those of `_VOXELS`, a table of
`CLASSES` displacements unless its block size is 0, and G-PCC's octree. A hybrid goes on with those
of `_HYBRID`, `CLASSES` displacements, and a whole stream of each kind, surface first. The last two
bytes are the low half of a CRC-32. Version 4 has hybrids; the others are as in version 3.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.primitives.manhattan_frame import (
    RotationVector,
    rotated_back,
    rotation_matrix,
)

MAGIC = b"PBPR"
VERSION, HYBRID_VERSION = 3, 4
"""Version of streams of one kind, as earlier decoders read them, and of hybrids."""
SURFACE, VOXELS, HYBRID, ROTATED, WITH_REVOLUTIONS = 1, 2, 3, 4, 8
"""Kinds of streams, and flags of those of surfaces."""
REVOLUTION_BYTES = 19
"""Bytes of the parameters of a surface of revolution."""
_START = struct.Struct("<4sBB")
_SURFACE = struct.Struct("<4f3HBBBBBBI")
_ROTATION = struct.Struct("<3h")
_VOXELS = struct.Struct("<4fB")
_HYBRID = struct.Struct("<BI")
_CHECKSUM = struct.Struct("<H")
VOXEL_HEADER_BYTES = _START.size + _VOXELS.size + _CHECKSUM.size
"""Bytes of a stream of voxels beside G-PCC's octree and the table of displacements."""
MAX_CELLS = 1 << 26
"""Cells of the grid, at most. This and those below bound a decoder's work and memory; a surface
that would exceed them is coded as voxels."""
MAX_NODES = 1 << 20
"""Nodes of the octree on all levels that are coded, and with them its leaves."""
MAX_LEAF_COLUMNS = 256
"""Columns across the largest leaf."""
MAX_COLUMNS = 1 << 22
"""Columns of all leaves."""
MAX_POINTS = 1 << 22
MAX_REVOLUTION_POINTS = 1 << 22
MAX_DISPLACED = 1 << 22
"""Voxels that are displaced; of more, none is."""
MAX_HYBRID_VOXELS = 1 << 20
"""Voxels beside a surface, whose nearest points each costs some microseconds to find."""
BLOCK_SIZES = (1, 2, 4)
"""Sides of blocks, in voxels, of which 3 x 3 x 3 share a local plane."""
CLASSES = 24
"""Classes of voxels that are displaced by the same share."""


MAX_REACH = 8
"""Sixteenths of a voxel from its centre to its sides."""


class GridPlacement(NamedTuple):
    """Where a grid lies in the cloud: its origin (3,) and the side of a cell."""

    origin: Floats
    cell_size: float

    def rounded(self) -> GridPlacement:
        """The placement in single precision, as a stream holds it."""
        origin = self.origin.astype(np.float32).astype(np.float64)
        return GridPlacement(origin, float(np.float32(self.cell_size)))


class DisplacementTable(NamedTuple):
    """Displacement of voxels: by class, the share of the distance to the local plane, in 1/64.

    block_size: side in voxels of the blocks of which 3 x 3 x 3 share a plane.
    """

    block_size: int
    factors: NDArray[np.int8]


class VoxelHeader(NamedTuple):
    """Header of a stream of voxels."""

    place: GridPlacement
    table: DisplacementTable | None


class HybridHeader(NamedTuple):
    """Contents of a stream of a surface and voxels.

    reach: points of the surface are kept within so many sixteenths of a voxel of an occupied
    voxel's centre, along each axis. factors: (`CLASSES`,) shares in 1/64 of the distance to the
    surface by which voxels move. surface, voxels: whole streams.
    """

    reach: int
    factors: NDArray[np.int8]
    surface: bytes
    voxels: bytes


class SurfaceHeader(NamedTuple):
    """Header of a stream of surfaces.

    origin: (3,) of the grid of cells, and cell_size, both in the cloud's coordinates. shape: (3,)
    cells. depth, finest_leaf_level, coarsest_leaf_level: levels of the cells and of the smallest
    and largest leaves. plane_step: quantisation step of planes at the smallest leaves, in 1/16
    cells. points_across: points across a column; column_spacing: columns from one point to the
    next; one of the two is 1. leaf_capacity: leaves, at most. rotation: from the cloud's axes to
    the grid's, about the cloud's origin. revolutions: `REVOLUTION_BYTES` for each surface of
    revolution.
    """

    origin: Floats
    cell_size: float
    shape: tuple[int, int, int]
    depth: int
    finest_leaf_level: int
    coarsest_leaf_level: int
    plane_step: int
    points_across: int
    column_spacing: int
    leaf_capacity: int
    rotation: RotationVector = (0, 0, 0)
    revolutions: bytes = b""

    def in_cloud(self, cells: Floats) -> Floats:
        """Points (n, 3) given in cells, in the cloud's coordinates."""
        return self.along_axes(cells * self.cell_size + self.origin)

    def along_axes(self, vectors: Floats) -> Floats:
        """Vectors (n, 3) along the grid's axes, along the cloud's."""
        return rotated_back(vectors, rotation_matrix(self.rotation))


def pack_surface(header: SurfaceHeader, bits: bytes) -> bytes:
    """A whole stream from a header and the arithmetic-coded bits."""
    is_rotated, revolutions = any(header.rotation), header.revolutions
    kind = SURFACE | (ROTATED if is_rotated else 0) | (WITH_REVOLUTIONS if revolutions else 0)
    head = _START.pack(MAGIC, VERSION, kind)
    head += _SURFACE.pack(*header.origin, header.cell_size, *header.shape, *header[3:-2])
    head += _ROTATION.pack(*header.rotation) if is_rotated else b""
    head += bytes([len(revolutions) // REVOLUTION_BYTES]) + revolutions if revolutions else b""
    return _with_checksum(head + bits)


def pack_voxels(place: GridPlacement, table: DisplacementTable | None, bits: bytes) -> bytes:
    """A whole stream from G-PCC's octree of the voxels and their displacements."""
    head = _START.pack(MAGIC, VERSION, VOXELS)
    head += _VOXELS.pack(*place.origin, place.cell_size, table.block_size if table else 0)
    return _with_checksum(head + (table.factors.tobytes() if table else b"") + bits)


def pack_hybrid(header: HybridHeader) -> bytes:
    """A whole stream of a surface and voxels."""
    head = _START.pack(MAGIC, HYBRID_VERSION, HYBRID)
    head += _HYBRID.pack(header.reach, len(header.surface)) + header.factors.tobytes()
    return _with_checksum(head + header.surface + header.voxels)


def unpack(stream: bytes) -> tuple[SurfaceHeader | VoxelHeader | HybridHeader, bytes]:
    """Header and coded bits of a stream; a hybrid's are in the streams that its header holds.

    Raises
    ------
    InputError
        If the stream is truncated or damaged, or of another version.
    """
    if len(stream) < _START.size + _CHECKSUM.size or not stream.startswith(MAGIC):
        raise InputError("not a stream of primitives, or truncated")
    body, checksum = stream[: -_CHECKSUM.size], _CHECKSUM.unpack(stream[-_CHECKSUM.size :])[0]
    _, version, kind = _START.unpack_from(body)
    if version != (HYBRID_VERSION if kind == HYBRID else VERSION):
        known_versions = f"{VERSION} and {HYBRID_VERSION}"
        raise InputError(f"the stream has version {version}, this codec reads {known_versions}")
    layout = {VOXELS: _VOXELS, HYBRID: _HYBRID}.get(kind, _SURFACE)
    known = kind in (VOXELS, HYBRID) or kind & ~(ROTATED | WITH_REVOLUTIONS) == SURFACE
    if not known or len(body) < _START.size + layout.size:
        raise InputError("the stream is truncated or of an unknown kind")
    if zlib.crc32(body) & 0xFFFF != checksum:
        raise InputError("the stream is damaged or truncated")
    numbers = layout.unpack_from(body, _START.size)
    bits = body[_START.size + layout.size :]
    if kind == HYBRID:
        return _hybrid_header(numbers[0], numbers[1], bits), b""
    place = np.array(numbers[:4])
    if not np.isfinite(place).all() or np.abs(place).max() > 1e30 or place[3] <= 0:
        raise InputError("the stream is damaged (its frame is not finite)")
    if kind == VOXELS:
        return _voxel_header(GridPlacement(place[:3], float(place[3])), numbers[4], bits)
    header = SurfaceHeader(place[:3], float(place[3]), numbers[4:7], *numbers[7:])
    if not is_decodable(header):
        raise InputError("the stream is damaged (its header makes no sense)")
    return _with_options(header, kind, bits)


def _with_options(header: SurfaceHeader, kind: int, bits: bytes) -> tuple[SurfaceHeader, bytes]:
    """The header with rotation and surfaces of revolution, where the kind has them; the rest."""
    if kind & ROTATED:
        if len(bits) < _ROTATION.size:
            raise InputError("the stream is truncated")
        header = header._replace(rotation=_ROTATION.unpack_from(bits))
        bits = bits[_ROTATION.size :]
    if kind & WITH_REVOLUTIONS:
        end = 1 + REVOLUTION_BYTES * bits[0] if bits else 1
        if len(bits) < end:
            raise InputError("the stream is truncated")
        header = header._replace(revolutions=bits[1:end])
        bits = bits[end:]
    return header, bits


def _hybrid_header(reach: int, surface_bytes: int, rest: bytes) -> HybridHeader:
    end = CLASSES + surface_bytes
    if reach > MAX_REACH or len(rest) < end:
        raise InputError("the stream is damaged (its parts make no sense)")
    factors = np.frombuffer(rest[:CLASSES], np.int8)
    return HybridHeader(reach, factors, rest[CLASSES:end], rest[end:])


def _voxel_header(place: GridPlacement, block_size: int, bits: bytes) -> tuple[VoxelHeader, bytes]:
    if block_size == 0:
        return VoxelHeader(place, None), bits
    if block_size not in BLOCK_SIZES or len(bits) < CLASSES:
        raise InputError("the stream is damaged (its table makes no sense)")
    factors = np.frombuffer(bits[:CLASSES], np.int8)
    return VoxelHeader(place, DisplacementTable(block_size, factors)), bits[CLASSES:]


def is_decodable(header: SurfaceHeader) -> bool:
    """Whether a header is consistent and asks for no more work and memory than is allowed."""
    size = np.array(header.shape, dtype=np.int64)
    depth, finest, coarsest = header.depth, header.finest_leaf_level, header.coarsest_leaf_level
    return bool(
        size.min() > 0
        and size.prod() <= MAX_CELLS
        and size.max() <= 1 << depth
        and 0 <= coarsest <= finest <= depth <= 16
        and 1 << (depth - coarsest) <= MAX_LEAF_COLUMNS
        and 1 <= header.points_across <= 16
        and 1 <= header.column_spacing <= 64
        and header.plane_step > 0
        and header.leaf_capacity <= MAX_NODES
    )


def _with_checksum(body: bytes) -> bytes:
    return body + _CHECKSUM.pack(zlib.crc32(body) & 0xFFFF)

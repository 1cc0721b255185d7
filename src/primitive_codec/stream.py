"""The bitstream of the codec: headers of its three kinds of streams are packed and checked here.

A stream contains a surface, voxels, or both (a hybrid). All numbers are little endian. A stream
starts with the magic ``PBPR``, a version and a kind. It ends with the low half of a CRC-32. Between
them are:

* Surface: `_SURFACE`; `_ROTATION` if the grid is rotated; the number and parameters of surfaces of
  revolution, if there are any; the arithmetic-coded payload.
* Voxels: `_VOXELS`; `CLASSES` displacement factors unless the block size is 0; a G-PCC octree.
* Hybrid (version 6): `_HYBRID`, `CLASSES` displacement factors, a surface stream, a voxel stream.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from primitive_codec.manhattan_frame import RotationVector, rotate_inverse, rotation_matrix
from primitive_codec.octree_arrays import SPACING_UNIT

MAGIC = b"PBPR"
VERSION, HYBRID_VERSION = 5, 6
"""Version of surface and voxel streams, and version of hybrid streams."""
SURFACE, VOXELS, HYBRID, ROTATED, WITH_REVOLUTIONS = 1, 2, 3, 4, 8
"""Kinds of streams, and flags added to the kind of a surface."""
REVOLUTION_BYTES = 19
"""Bytes of the parameters of one surface of revolution."""
_START = struct.Struct("<4sBB")
_SURFACE = struct.Struct("<4f3HBBBBHI")
_ROTATION = struct.Struct("<3h")
_VOXELS = struct.Struct("<4fB")
_HYBRID = struct.Struct("<BI")
_CHECKSUM = struct.Struct("<H")
VOXEL_HEADER_BYTES = _START.size + _VOXELS.size + _CHECKSUM.size
"""Bytes of a voxel stream besides the G-PCC octree and the displacement factors."""
MAX_CELLS = 1 << 26
"""Largest number of cells of the grid. This limit and those below bound a decoder's work and
memory; if a surface exceeds them, the encoder codes voxels."""
MAX_NODES = 1 << 20
"""Largest number of coded octree nodes, leaves included."""
MAX_LEAF_COLUMNS = 256
"""Largest number of columns across a leaf."""
MAX_COLUMNS = 1 << 22
"""Largest number of columns of all leaves."""
MAX_POINTS = 1 << 22
MAX_REVOLUTION_POINTS = 1 << 22
MIN_POINT_SPACING, MAX_POINT_SPACING = SPACING_UNIT // 16, (1 << 16) - 1
MAX_DISPLACED = 1 << 22
MAX_HYBRID_VOXELS = 1 << 20
"""Largest number of voxels of a hybrid; finding a voxel's surface point takes microseconds."""
BLOCK_SIZES = (1, 2, 4)
"""Possible sides of a block in voxels. A local plane is fitted to 3 x 3 x 3 blocks."""
CLASSES = 24
"""Number of classes of voxels, each with one displacement factor."""

MAX_KEEP_DISTANCE = 8
"""Largest keep distance, in 1/16 voxels: half the side of a voxel."""


class VoxelGrid(NamedTuple):
    """A grid of cubic voxels. The voxel (0, 0, 0) has its centre at the origin."""

    origin: Floats  # (3,)
    cell_size: float

    def rounded(self) -> VoxelGrid:
        """Return the grid with numbers rounded to single precision, as streams store them."""
        origin = self.origin.astype(np.float32).astype(np.float64)
        return VoxelGrid(origin, float(np.float32(self.cell_size)))


class DisplacementTable(NamedTuple):
    """Factors by which a decoder moves voxel centres towards the planes of their neighbourhoods.

    A voxel belongs to one of `CLASSES` classes. A factor of 64 moves its centre onto the plane.
    """

    block_size: int  # side of a block in voxels
    factors: NDArray[np.int8]  # (CLASSES,)


class VoxelHeader(NamedTuple):
    """The header of a voxel stream."""

    grid: VoxelGrid
    displacements: DisplacementTable | None


class HybridHeader(NamedTuple):
    """The header of a hybrid stream, which includes a surface stream and a voxel stream.

    The decoder keeps a surface point if it lies, along each axis, within `keep_distance` of the
    centre of an occupied voxel.
    """

    keep_distance: int  # in 1/16 voxels
    factors: NDArray[np.int8]  # (CLASSES,) in 1/64 of the distance to the surface
    surface: bytes  # complete stream
    voxels: bytes  # complete stream


class SurfaceHeader(NamedTuple):
    """The header of a surface stream: the grid of the octree, and the surfaces of revolution."""

    origin: Floats  # (3,) of the grid, along its axes
    cell_size: float  # in the cloud's unit
    shape: tuple[int, int, int]  # cells along each axis
    depth: int  # level of the cells
    finest_leaf_level: int  # of the smallest leaves
    coarsest_leaf_level: int  # of the largest leaves
    plane_step: int  # quantisation step in the smallest leaves, in 1/16 cells
    point_spacing: int  # from one point to the next, in columns / SPACING_UNIT
    leaf_capacity: int  # bound of the number of leaves
    rotation: RotationVector = (0, 0, 0)  # from the cloud's axes to the grid's
    revolutions: bytes = b""  # packed surfaces of revolution

    def in_cloud(self, cells: Floats) -> Floats:
        """Convert points (n, 3) from cells of the grid to the coordinates of the cloud."""
        return self.rotate_back(cells * self.cell_size + self.origin)

    def rotate_back(self, vectors: Floats) -> Floats:
        """Rotate vectors (n, 3) from the axes of the grid to the axes of the cloud."""
        return rotate_inverse(vectors, rotation_matrix(self.rotation))


def pack_surface(header: SurfaceHeader, payload: bytes) -> bytes:
    """Return the bytes of a surface stream."""
    is_rotated, revolutions = any(header.rotation), header.revolutions
    kind = SURFACE | (ROTATED if is_rotated else 0) | (WITH_REVOLUTIONS if revolutions else 0)
    prefix = _START.pack(MAGIC, VERSION, kind)
    prefix += _SURFACE.pack(*header.origin, header.cell_size, *header.shape, *header[3:-2])
    prefix += _ROTATION.pack(*header.rotation) if is_rotated else b""
    prefix += bytes([len(revolutions) // REVOLUTION_BYTES]) + revolutions if revolutions else b""
    return _with_checksum(prefix + payload)


def pack_voxels(grid: VoxelGrid, displacements: DisplacementTable | None, payload: bytes) -> bytes:
    """Return the bytes of a voxel stream.

    Parameters
    ----------
    grid
        Grid of the voxels.
    displacements
        Displacement factors, or None if decoded points are the centres of the voxels.
    payload
        G-PCC octree of the voxels.
    """
    block_size, factors = 0, b""
    if displacements:
        block_size, factors = displacements.block_size, displacements.factors.tobytes()
    prefix = _START.pack(MAGIC, VERSION, VOXELS)
    prefix += _VOXELS.pack(*grid.origin, grid.cell_size, block_size)
    return _with_checksum(prefix + factors + payload)


def pack_hybrid(header: HybridHeader) -> bytes:
    """Return the bytes of a hybrid stream."""
    prefix = _START.pack(MAGIC, HYBRID_VERSION, HYBRID)
    prefix += _HYBRID.pack(header.keep_distance, len(header.surface)) + header.factors.tobytes()
    return _with_checksum(prefix + header.surface + header.voxels)


def unpack(stream: bytes) -> tuple[SurfaceHeader | VoxelHeader | HybridHeader, bytes]:
    """Check a stream, and split it into its header and its payload.

    Returns
    -------
    header
        A header of the stream's kind. The header of a hybrid contains two complete streams, one of
        a surface and one of voxels.
    payload
        The bytes after the header; none for a hybrid.

    Raises
    ------
    InputError
        If the stream is truncated, damaged, or of another version.
    """
    if len(stream) < _START.size + _CHECKSUM.size or not stream.startswith(MAGIC):
        raise InputError("not a stream of primitives, or truncated")
    body, checksum = stream[: -_CHECKSUM.size], _CHECKSUM.unpack(stream[-_CHECKSUM.size :])[0]
    reader = Reader(body)
    _, version, kind = _START.unpack(reader.take(_START.size))
    if version != (HYBRID_VERSION if kind == HYBRID else VERSION):
        known_versions = f"{VERSION} and {HYBRID_VERSION}"
        raise InputError(f"the stream has version {version}, this codec reads {known_versions}")
    if kind not in (VOXELS, HYBRID) and kind & ~(ROTATED | WITH_REVOLUTIONS) != SURFACE:
        raise InputError("the stream is of an unknown kind")
    if zlib.crc32(body) & 0xFFFF != checksum:
        raise InputError("the stream is damaged or truncated")
    field_struct = {VOXELS: _VOXELS, HYBRID: _HYBRID}.get(kind, _SURFACE)
    fields = field_struct.unpack(reader.take(field_struct.size))
    if kind == HYBRID:
        return _read_hybrid(fields[0], fields[1], reader), b""
    grid = _voxel_grid(fields[:4])
    if kind == VOXELS:
        return VoxelHeader(grid, _read_displacements(fields[4], reader)), reader.rest()
    header = SurfaceHeader(*grid, fields[4:7], *fields[7:])
    if not is_decodable(header):
        raise InputError("the stream is damaged (its header is invalid)")
    if kind & ROTATED:
        header = header._replace(rotation=_ROTATION.unpack(reader.take(_ROTATION.size)))
    if kind & WITH_REVOLUTIONS:
        header = header._replace(revolutions=reader.take(REVOLUTION_BYTES * reader.take(1)[0]))
    return header, reader.rest()


def unpack_surface(stream: bytes) -> tuple[SurfaceHeader, bytes]:
    """Split a surface stream, or the surface stream in a hybrid, into its header and its payload.

    Raises
    ------
    InputError
        If the stream is damaged, or holds only voxels.
    """
    header, payload = unpack(stream)
    if isinstance(header, HybridHeader):
        header, payload = unpack(header.surface)
    if not isinstance(header, SurfaceHeader):
        raise InputError("the stream holds voxels, not planes: take another rate")
    return header, payload


def _voxel_grid(fields: tuple[float, ...]) -> VoxelGrid:
    values = np.array(fields)
    if not np.isfinite(values).all() or np.abs(values).max() > 1e30 or values[3] <= 0:
        raise InputError("the stream is damaged (its grid is not finite)")
    return VoxelGrid(values[:3], float(values[3]))


def _read_hybrid(keep_distance: int, surface_bytes: int, reader: Reader) -> HybridHeader:
    rest = len(reader.body) - reader.at
    if keep_distance > MAX_KEEP_DISTANCE or rest < CLASSES + surface_bytes:
        raise InputError("the stream is damaged (its parts are invalid)")
    factors = np.frombuffer(reader.take(CLASSES), np.int8)
    return HybridHeader(keep_distance, factors, reader.take(surface_bytes), reader.rest())


def _read_displacements(block_size: int, reader: Reader) -> DisplacementTable | None:
    if block_size not in (0, *BLOCK_SIZES):
        raise InputError("the stream is damaged (its displacement table is invalid)")
    if block_size == 0:
        return None
    return DisplacementTable(block_size, np.frombuffer(reader.take(CLASSES), np.int8))


def is_decodable(header: SurfaceHeader) -> bool:
    """Return whether a header is consistent and within the limits that bound a decoder's work."""
    shape = np.array(header.shape, dtype=np.int64)
    depth, finest, coarsest = header.depth, header.finest_leaf_level, header.coarsest_leaf_level
    return bool(
        shape.min() > 0
        and shape.prod() <= MAX_CELLS
        and shape.max() <= 1 << depth
        and 0 <= coarsest <= finest <= depth <= 16
        and 1 << (depth - coarsest) <= MAX_LEAF_COLUMNS
        and header.point_spacing >= MIN_POINT_SPACING
        and header.plane_step > 0
        and header.leaf_capacity <= MAX_NODES
    )


def _with_checksum(body: bytes) -> bytes:
    return body + _CHECKSUM.pack(zlib.crc32(body) & 0xFFFF)

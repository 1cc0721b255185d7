"""Decoder of the primitives codec: from a stream to patches, and to points with normals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.coding.binary_coder import exhausted
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.primitives import hybrid_mode, voxel_mode
from puckbench.primitives.entropy import reader
from puckbench.primitives.occupancy_decision import NO_CRITERION
from puckbench.primitives.occupancy_map import code_occupancy_maps
from puckbench.primitives.octree_arrays import (
    Bytes,
    Ints,
    LeafMap,
    Leaves,
    Nodes,
    OctreeGeometry,
)
from puckbench.primitives.reconstruction import count_points, reconstruct_points
from puckbench.primitives.revolution import (
    CONTEXTS,
    MIXERS,
    RevolutionSurface,
    code_unrolled_map,
    sample_surface,
    unpack_parameters,
)
from puckbench.primitives.stream import (
    MAX_COLUMNS,
    MAX_POINTS,
    MAX_REVOLUTION_POINTS,
    HybridHeader,
    SurfaceHeader,
    unpack,
)
from puckbench.primitives.traversal import code_octree

_STEP_EXPONENT = 0.5
"""Planes of larger leaves have finer steps, by the ratio of the sides to this power."""


class DecodedSurface(NamedTuple):
    """Points (m, 3) in the cloud's coordinates, unit normals (m, 3) of any sign, and planes (m,).

    A plane is the index of the plane or surface of revolution that a point lies on; leaves share
    planes.
    """

    xyz: Floats
    normals: Floats
    planes: Ints


class Patches(NamedTuple):
    """A stream's surfaces before points are made on them.

    occupancy: states of the cells that columns end in. revolutions: each with its occupancy map.
    """

    header: SurfaceHeader
    geometry: OctreeGeometry
    leaves: Leaves
    occupancy: Bytes
    revolutions: list[tuple[RevolutionSurface, Bytes]]


def decode_stream(stream: bytes) -> Floats:
    """Decode a stream of any mode.

    Returns
    -------
    ndarray
        (m, 3) points in the coordinates of the encoded cloud.

    Raises
    ------
    InputError
        If the stream is damaged.
    """
    header, bits = unpack(stream)
    if isinstance(header, SurfaceHeader):
        return decode_surface(header, bits).xyz
    if isinstance(header, HybridHeader):
        surface = decode_surface(*surface_part(stream))
        return hybrid_mode.decode(header, surface.xyz, surface.normals)
    return voxel_mode.decode(header.place, header.table, bits)


def surface_part(stream: bytes) -> tuple[SurfaceHeader, bytes]:
    """Header and coded bits of the surface of a stream, which may be a hybrid.

    Raises
    ------
    InputError
        If the stream is damaged or holds voxels alone.
    """
    header, bits = unpack(stream)
    if isinstance(header, HybridHeader):
        header, bits = unpack(header.surface)
    if not isinstance(header, SurfaceHeader):
        raise InputError("the stream holds voxels, not planes: take another rate")
    return header, bits


def decode_surface(header: SurfaceHeader, bits: bytes) -> DecodedSurface:
    """Points of a stream of surfaces; InputError if it is damaged."""
    return points_and_normals(read_patches(header, bits))


def points_and_normals(patches: Patches) -> DecodedSurface:
    """Points of planes and surfaces of revolution; InputError for too many, or none."""
    xyz, rows = plane_points(patches)
    planes = patches.leaves.plane_index[rows]
    normals = patches.header.along_axes(patches.leaves.planes[planes, :3])
    found = DecodedSurface(xyz, normals, planes)
    return _concatenated([found, *revolution_points(patches)])


def revolution_points(patches: Patches) -> list[DecodedSurface]:
    """Points of each surface of revolution, its index after those of the planes."""
    header, found = patches.header, []
    columns = sum(int(bits.sum()) for _, bits in patches.revolutions)
    if columns * header.points_across**2 > MAX_REVOLUTION_POINTS:
        raise InputError(f"the stream is damaged ({columns} columns of surfaces of revolution)")
    for k, (surface, bits) in enumerate(patches.revolutions):
        cells, normals = sample_surface(surface, bits, header.points_across, header.column_spacing)
        indices = np.full(len(cells), int(patches.leaves.counts[1]) + k)
        placed = header.in_cloud(cells), header.along_axes(normals)
        found.append(DecodedSurface(*placed, indices))
    return found


def _concatenated(parts: list[DecodedSurface]) -> DecodedSurface:
    xyz, normals, planes = (np.concatenate(part) for part in zip(*parts, strict=True))
    if not 0 < len(xyz) <= MAX_POINTS:
        raise InputError(f"the stream is damaged ({len(xyz)} points)")
    return DecodedSurface(xyz, normals, planes)


def plane_points(patches: Patches) -> tuple[Floats, Ints]:
    """Points (m, 3) of planes in the cloud's coordinates, and their leaves (m,)."""
    header = patches.header
    surface = (
        patches.geometry,
        patches.leaves,
        patches.occupancy,
        header.points_across,
        header.column_spacing,
    )
    count = count_points(*surface)
    if count > MAX_POINTS:
        raise InputError(f"the stream is damaged ({count} points)")
    xyz, rows = np.empty((count, 3)), np.empty(count, np.int64)
    reconstruct_points(*surface, xyz, rows)
    return header.in_cloud(xyz), rows


def read_patches(header: SurfaceHeader, bits: bytes) -> Patches:
    """Decode the surfaces of a stream; InputError if it is damaged."""
    geometry = octree_geometry(header)
    leaves, leaf_map, occupancy = empty_arrays(header)
    coder = reader(bits, CONTEXTS, MIXERS)
    revolutions = [
        (surface, np.zeros(int(surface.columns().sum()), np.uint8))
        for surface in unpack_parameters(header.revolutions)
    ]
    whole = code_octree(coder, geometry, _NO_NODES, leaves, leaf_map)
    if whole:
        if columns_of(leaves) > MAX_COLUMNS:
            raise InputError(f"the stream is damaged ({columns_of(leaves)} columns)")
        code_occupancy_maps(coder, geometry, leaves, leaf_map, NO_CRITERION, occupancy)
        for surface, columns in revolutions:
            code_unrolled_map(coder, surface.columns(), columns)
    if not whole or exhausted(coder.bits):
        raise InputError("the stream is damaged (its octree is too large, or it ends too early)")
    return Patches(header, geometry, leaves, occupancy, revolutions)


def columns_of(leaves: Leaves) -> int:
    """Columns of all leaves, whether their planes cross them or not."""
    return int((leaves.side[: leaves.counts[0]] ** 2).sum())


def octree_geometry(header: SurfaceHeader, lmbda: float = 0.0) -> OctreeGeometry:
    """Geometry of the octree that a header describes."""
    levels_above_finest = np.maximum(header.finest_leaf_level - np.arange(header.depth + 1), 0)
    steps = header.plane_step / 16 * 2.0 ** (-_STEP_EXPONENT * levels_above_finest)
    shape = np.array(header.shape, np.int64)
    return OctreeGeometry(
        header.depth, header.finest_leaf_level, header.coarsest_leaf_level, shape, steps, lmbda
    )


def empty_arrays(header: SurfaceHeader) -> tuple[Leaves, LeafMap, Bytes]:
    """Room for the leaves, the grid of the smallest leaves, and the grid of column states."""
    n = header.leaf_capacity
    corner, side, plane = np.zeros((n, 3), np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
    leaves = Leaves(corner, side, plane, np.zeros((n, 4)), np.zeros(2, np.int64))
    down = header.depth - header.finest_leaf_level
    leaf_map = np.zeros([((cells - 1) >> down) + 1 for cells in header.shape], np.int32)
    return leaves, leaf_map, np.zeros(header.shape, np.uint8)


_NO_NODES = Nodes(
    np.zeros((1, 10)),
    np.zeros(2, np.int64),
    np.zeros(1, np.bool_),
    np.zeros(1, np.int64),
    np.zeros((1, 10)),
)

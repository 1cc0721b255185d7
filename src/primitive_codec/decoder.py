from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import exhausted
from pointkit.compiling import compiled, compiled_in_place
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from primitive_codec import hybrid_mode, voxel_mode
from primitive_codec.entropy import reader
from primitive_codec.occupancy_map import NO_CRITERION, code_occupancy_maps, find_leaf_cell
from primitive_codec.octree_arrays import (
    OCCUPIED,
    SPACING_UNIT,
    EncoderNodes,
    Ints,
    Leaves,
    OctreeGeometry,
    PlaneOctree,
    dominant_axis,
    first_point,
    plane_height,
)
from primitive_codec.revolution import (
    CONTEXTS,
    MIXERS,
    UnrolledMap,
    code_unrolled_map,
    count_column_points,
    reconstruct_columns,
    unpack_parameters,
)
from primitive_codec.stream import (
    MAX_COLUMNS,
    MAX_POINTS,
    MAX_REVOLUTION_POINTS,
    HybridHeader,
    SurfaceHeader,
    VoxelHeader,
    unpack,
    unpack_surface,
)
from primitive_codec.traversal import code_octree

_PLANE_STEP_EXPONENT = 0.5
"""A plane's quantisation step is divided by (leaf side / smallest leaf side) to this power."""


class DecodedSurface(NamedTuple):
    """Points of a decoded surface.

    Attributes
    ----------
    xyz
        Coordinates (m, 3) in the cloud's unit.
    normals
        Unit normals (m, 3); their signs are arbitrary.
    primitive_index
        Index (m,) of the primitive on which each point lies. Planes have the lowest indices, then
        come cylinders, cones and spheres.
    """

    xyz: Floats
    normals: Floats
    primitive_index: Ints


class Patches(NamedTuple):
    """Decoded primitives and their occupancy maps."""

    header: SurfaceHeader
    octree: PlaneOctree
    revolutions: list[UnrolledMap]


def decode(stream: bytes) -> Floats:
    """Decode a stream to points.

    Returns
    -------
    ndarray
        float64 (m, 3) in the cloud's unit. The points lie on the coded surfaces and in the coded
        voxels; they are neither those of the input nor equally many.

    Raises
    ------
    InputError
        If the stream is damaged.
    """
    header, payload = unpack(stream)
    if isinstance(header, VoxelHeader):
        return voxel_mode.decode(header, payload)
    surface = decode_surface(stream)
    if isinstance(header, HybridHeader):
        return hybrid_mode.decode(header, surface.xyz, surface.normals)
    return surface.xyz


def decode_surface(stream: bytes) -> DecodedSurface:
    """Decode the surface of a stream to points with normals; the voxels of a hybrid are left out.

    Raises
    ------
    InputError
        If the stream is damaged, or holds only voxels.
    """
    return reconstruct_surface(read_patches(stream))


def read_patches(stream: bytes) -> Patches:
    header, payload = unpack_surface(stream)
    octree = empty_octree(header)
    coder = reader(payload, CONTEXTS, MIXERS)
    revolutions = [
        UnrolledMap(surface, np.zeros(surface.column_count(), np.uint8))
        for surface in unpack_parameters(header.revolutions)
    ]
    is_complete = code_octree(coder, octree, _NO_NODES)
    if is_complete:
        if (columns := count_columns(octree.leaves)) > MAX_COLUMNS:
            raise InputError(f"the stream is damaged ({columns} columns)")
        code_occupancy_maps(coder, octree, NO_CRITERION)
        for surface, bits in revolutions:
            code_unrolled_map(coder, surface.columns_per_row(), bits)
    if not is_complete or exhausted(coder.bits):
        raise InputError("the stream is damaged (its octree is too large, or it ends too early)")
    return Patches(header, octree, revolutions)


def reconstruct_surface(patches: Patches) -> DecodedSurface:
    """Return points on all primitives; raise InputError unless there are 1 to `MAX_POINTS`."""
    xyz, leaf_of_point = reconstruct_planes(patches)
    leaves = patches.octree.leaves
    planes = leaves.plane_index[leaf_of_point]
    normals = patches.header.rotate_back(leaves.planes[planes, :3])
    parts = [DecodedSurface(xyz, normals, planes), *reconstruct_revolutions(patches)]
    surface = DecodedSurface(*map(np.concatenate, zip(*parts, strict=True)))
    if not 0 < len(surface.xyz) <= MAX_POINTS:
        raise InputError(f"the stream is damaged ({len(surface.xyz)} points)")
    return surface


def reconstruct_planes(patches: Patches) -> tuple[Floats, Ints]:
    """Return points (m, 3) on all planes, in cloud coordinates, and their leaf indices (m,)."""
    header, octree = patches.header, patches.octree
    count = count_points(octree, header.point_spacing)
    if count > MAX_POINTS:
        raise InputError(f"the stream is damaged ({count} points)")
    xyz, leaf_of_point = np.empty((count, 3)), np.empty(count, np.int64)
    reconstruct_points(octree, header.point_spacing, xyz, leaf_of_point)
    return header.in_cloud(xyz), leaf_of_point


def reconstruct_revolutions(patches: Patches) -> list[DecodedSurface]:
    header, plane_count = patches.header, int(patches.octree.leaves.counts[1])
    count = count_revolution_points(patches, header.point_spacing)
    if count > MAX_REVOLUTION_POINTS:
        raise InputError(f"the stream is damaged ({count} points on surfaces of revolution)")
    parts = []
    for index, unrolled in enumerate(patches.revolutions, start=plane_count):
        xyz, normals = reconstruct_columns(unrolled, header.point_spacing)
        indices = np.full(len(xyz), index)
        parts.append(DecodedSurface(header.in_cloud(xyz), header.rotate_back(normals), indices))
    return parts


def count_surface_points(patches: Patches, spacing: int) -> int:
    return count_points(patches.octree, spacing) + count_revolution_points(patches, spacing)


def count_revolution_points(patches: Patches, spacing: int) -> int:
    return sum(count_column_points(unrolled, spacing) for unrolled in patches.revolutions)


def count_columns(leaves: Leaves) -> int:
    return int((leaves.side[: leaves.counts[0]] ** 2).sum())


def empty_octree(header: SurfaceHeader, lmbda: float = 0.0) -> PlaneOctree:
    levels_above_finest = np.maximum(header.finest_leaf_level - np.arange(header.depth + 1), 0)
    steps = header.plane_step / 16 * 2.0 ** (-_PLANE_STEP_EXPONENT * levels_above_finest)
    shape = np.array(header.shape, np.int64)
    geometry = OctreeGeometry(
        header.depth, header.finest_leaf_level, header.coarsest_leaf_level, shape, steps, lmbda
    )
    n = header.leaf_capacity
    corner, side, plane = np.zeros((n, 3), np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
    leaves = Leaves(corner, side, plane, np.zeros((n, 4)), np.zeros(2, np.int64))
    side_log2 = header.depth - header.finest_leaf_level
    leaf_grid = np.zeros([((cells - 1) >> side_log2) + 1 for cells in header.shape], np.int32)
    return PlaneOctree(geometry, leaves, leaf_grid, np.zeros(header.shape, np.uint8))


_NO_NODES = EncoderNodes(
    np.zeros((1, 10)),
    np.zeros(2, np.int64),
    np.zeros(1, np.bool_),
    np.zeros(1, np.int64),
    np.zeros((1, 10)),
)


@compiled
def count_points(octree: PlaneOctree, spacing: int) -> int:
    return int(reconstruct_points(octree, spacing, np.empty((0, 3)), np.empty(0, np.int64)))


@compiled
def reconstruct_points(octree: PlaneOctree, spacing: int, xyz: Floats, leaf_of_point: Ints) -> int:
    """Place points on a square grid over all occupied columns of the planes, and return their
    number.

    Parameters
    ----------
    octree
        The decoded planes with their occupancy maps.
    spacing
        Distance of the points, in columns / `SPACING_UNIT`.
    xyz
        Receives the points (m, 3), in cells; those beyond m are only counted.
    leaf_of_point
        Receives the index (m,) of each point's leaf.
    """
    leaves, count = octree.leaves, 0
    cell = np.zeros(3, np.int64)
    for i in range(leaves.counts[0]):
        axis = dominant_axis(leaves.planes[leaves.plane_index[i]])
        low_u, low_v = leaves.corner[i, (axis + 1) % 3], leaves.corner[i, (axis + 2) % 3]
        for a in range(low_u, low_u + leaves.side[i]):
            rows = (first_point(a, spacing), first_point(a + 1, spacing))
            if rows[0] == rows[1]:
                continue
            for b in range(low_v, low_v + leaves.side[i]):
                columns = (first_point(b, spacing), first_point(b + 1, spacing))
                points = (rows[1] - rows[0]) * (columns[1] - columns[0])
                if (
                    points > 0
                    and find_leaf_cell(octree, i, axis, a, b, cell)
                    and octree.occupancy[cell[0], cell[1], cell[2]] == OCCUPIED
                ):
                    _reconstruct_column(
                        leaves, i, axis, rows, columns, spacing, xyz[count:], leaf_of_point[count:]
                    )
                    count += points
    return count


@compiled_in_place
def _reconstruct_column(
    leaves: Leaves,
    i: int,
    axis: int,
    rows: tuple[int, int],
    columns: tuple[int, int],
    spacing: int,
    xyz: Floats,
    leaf_of_point: Ints,
) -> None:
    k = 0
    for column in range(columns[0], columns[1]):
        for row in range(rows[0], rows[1]):
            if k == len(xyz):
                return
            u = (row + 0.5) * spacing / SPACING_UNIT
            v = (column + 0.5) * spacing / SPACING_UNIT
            xyz[k, axis] = plane_height(leaves.planes[leaves.plane_index[i]], axis, u, v)
            xyz[k, (axis + 1) % 3], xyz[k, (axis + 2) % 3] = u, v
            leaf_of_point[k] = i
            k += 1

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
    """Points of a decoded surface, with their normals and primitives.

    Attributes
    ----------
    xyz
        Coordinates (m, 3) in the unit of the encoded cloud.
    normals
        Unit normals (m, 3); their signs are arbitrary.
    primitive_index
        Index (m,) of the primitive on which each point lies. The planes come first; cylinders,
        cones and spheres follow.
    """

    xyz: Floats
    normals: Floats
    primitive_index: Ints


class Patches(NamedTuple):
    """The primitives and occupancy maps from which points or a mesh are made."""

    header: SurfaceHeader
    octree: PlaneOctree
    revolutions: list[UnrolledMap]


def decode(stream: bytes) -> Floats:
    """Decode a stream to points.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.

    Returns
    -------
    ndarray
        Coordinates (m, 3), float64, in the unit of the encoded cloud. The points lie on the coded
        surfaces and in the coded voxels, so their positions and their number differ from the
        input's.

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
    """Decode the surface of a stream to points with normals.

    Points of voxels, which a stream may contain in addition to the surface, are left out.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.

    Returns
    -------
    DecodedSurface
        Coordinates, normals and primitive indices of the points.

    Raises
    ------
    InputError
        If the stream is damaged, or holds only voxels.
    """
    return reconstruct_surface(read_patches(stream))


def read_patches(stream: bytes) -> Patches:
    """Decode the primitives and the occupancy maps of a stream, but make no points.

    Raises InputError if the stream is damaged, or holds only voxels.
    """
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
    """Place points on all primitives.

    Raises
    ------
    InputError
        If there would be no points, or more than `MAX_POINTS`.
    """
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
    """Place points on all planes.

    Returns
    -------
    xyz
        Points (m, 3) in the coordinates of the cloud.
    leaf_of_point
        Index (m,) of the leaf to which each point belongs.

    Raises
    ------
    InputError
        If there would be more than `MAX_POINTS` points.
    """
    header, octree = patches.header, patches.octree
    count = count_points(octree, header.point_spacing)
    if count > MAX_POINTS:
        raise InputError(f"the stream is damaged ({count} points)")
    xyz, leaf_of_point = np.empty((count, 3)), np.empty(count, np.int64)
    reconstruct_points(octree, header.point_spacing, xyz, leaf_of_point)
    return header.in_cloud(xyz), leaf_of_point


def reconstruct_revolutions(patches: Patches) -> list[DecodedSurface]:
    """Place points on the cylinders, cones and spheres, and return them by surface.

    Raises InputError if there would be more than `MAX_REVOLUTION_POINTS` points.
    """
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
    """Return how many points lie on all primitives at a spacing, in columns / `SPACING_UNIT`."""
    return count_points(patches.octree, spacing) + count_revolution_points(patches, spacing)


def count_revolution_points(patches: Patches, spacing: int) -> int:
    """Return how many points lie on surfaces of revolution at a spacing.

    The spacing is in columns / `SPACING_UNIT`.
    """
    return sum(count_column_points(unrolled, spacing) for unrolled in patches.revolutions)


def count_columns(leaves: Leaves) -> int:
    """Return the number of columns in the occupancy maps of all leaves."""
    return int((leaves.side[: leaves.counts[0]] ** 2).sum())


def empty_octree(header: SurfaceHeader, lmbda: float = 0.0) -> PlaneOctree:
    """Allocate the octree that a header describes, for the encoder or the decoder to fill.

    Parameters
    ----------
    header
        Header of the surface stream.
    lmbda
        The encoder's weight of a bit, in squared cells; a decoder does not need it.
    """
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
    """Return how many points lie on planes at a spacing, in columns / `SPACING_UNIT`."""
    return int(reconstruct_points(octree, spacing, np.empty((0, 3)), np.empty(0, np.int64)))


@compiled
def reconstruct_points(octree: PlaneOctree, spacing: int, xyz: Floats, leaf_of_point: Ints) -> int:
    """Place points on a square grid over all occupied columns of the planes.

    Parameters
    ----------
    octree
        The decoded planes with their occupancy maps.
    spacing
        Distance between adjacent points, in columns / `SPACING_UNIT`.
    xyz
        Array that receives the points, in cells. If it is too short, the remaining points are only
        counted.
    leaf_of_point
        Array that receives the index of each point's leaf.

    Returns
    -------
    int
        Number of points, whether or not they fit into `xyz`.
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

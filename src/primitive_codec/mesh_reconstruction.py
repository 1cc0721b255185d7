"""Mesh reconstruction: the occupied columns of each leaf's plane are covered by few rectangles."""

from __future__ import annotations

import numpy as np

from pointkit.compiling import compiled
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject
from primitive_codec.decoder import (
    Patches,
    read_patches,
    reconstruct_planes,
    reconstruct_revolutions,
)
from primitive_codec.occupancy_map import find_leaf_cell
from primitive_codec.octree import moments_of
from primitive_codec.octree_arrays import (
    OCCUPIED,
    Bytes,
    Ints,
    PlaneOctree,
    dominant_axis,
    plane_height,
)
from primitive_codec.region_merging import MergeLimits, adjacent_leaves, merge_regions
from primitive_codec.revolution import SPHERE, RevolutionSurface, column_corners
from primitive_codec.stream import SurfaceHeader

_MAX_LEAVES, _MAX_RECTANGLES = 1 << 16, 1 << 20
"""Limits of work and memory."""
_MIN_CONE_ANGLE = 0.02
"""Angle in radians below which a cone is labelled as a cylinder."""
_MIN_COSINE = float(np.cos(np.radians(20)))
_CHUNK = 1 << 18
"""Number of points whose moments are computed at once."""
_MAX_ADDED_ERROR = 0.2
"""Largest squared error that a merge may add per point of the smaller segment, in squared
columns."""


def decode_mesh(stream: bytes) -> Mesh:
    """Decode the surface of a stream to triangles that are labelled by primitive and object.

    Each triangle belongs to a primitive with known parameters: a plane (unit normal and offset,
    ``normal . p = offset``), a cylinder, a cone or a sphere. Each triangle also belongs to an
    object. Planes that continue each other form one object, called a segment. Each surface of
    revolution is an object of its own.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.

    Returns
    -------
    Mesh
        Vertices in the unit of the encoded cloud, triangles, and `labels` with primitives and
        objects.

    Raises
    ------
    InputError
        If the stream is damaged, holds only voxels, or would make more than 1,048,576 rectangles.
    """
    patches = read_patches(stream)
    quads, leaf_of_quad = _plane_quads(patches)
    revolution_quads = [column_corners(unrolled) for unrolled in patches.revolutions]
    quads = np.concatenate([quads, *revolution_quads])
    if not len(quads):
        raise InputError("the stream is damaged (it has no surface)")
    vertices = patches.header.in_cloud(quads.reshape(-1, 3))
    corners = np.arange(4 * len(quads)).reshape(-1, 4)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    labels = _labels(patches, leaf_of_quad, [len(quads) for quads in revolution_quads])
    return Mesh(vertices, triangles, labels)


def _plane_quads(patches: Patches) -> tuple[Floats, Ints]:
    if patches.octree.leaves.counts[0] > _MAX_LEAVES:
        raise InputError(f"the stream has more than {_MAX_LEAVES} leaves, too many for a mesh")
    octree = patches.octree
    count = _cover_with_rectangles(octree, np.empty((0, 4, 3)), np.empty(0, np.int64))
    revolution_count = sum(int(unrolled.bits.sum()) for unrolled in patches.revolutions)
    if count + revolution_count > _MAX_RECTANGLES:
        raise InputError(f"the stream has more than {_MAX_RECTANGLES} rectangles of a mesh")
    quads, leaf_of_quad = np.empty((count, 4, 3)), np.empty(count, np.int64)
    _cover_with_rectangles(octree, quads, leaf_of_quad)
    return quads, leaf_of_quad


def _labels(patches: Patches, leaf_of_quad: Ints, revolution_quads: list[int]) -> Labels:
    header, leaves = patches.header, patches.octree.leaves
    plane_ids, plane_of_quad = np.unique(leaves.plane_index[leaf_of_quad], return_inverse=True)
    segments, segment_of_quad = np.unique(
        segment_leaves(patches)[leaf_of_quad], return_inverse=True
    )
    primitives = _plane_primitives(header, leaves.planes[plane_ids])
    primitives += [_revolution_primitive(header, surface) for surface, _ in patches.revolutions]
    objects = [SceneObject(f"segment_{k + 1}", "segment") for k in range(len(segments))]
    objects += [SceneObject(f"round_{k + 1}", "round") for k in range(len(revolution_quads))]
    revolution_of_quad = np.repeat(np.arange(len(revolution_quads)), revolution_quads)
    primitive_id = np.tile(np.concatenate([plane_of_quad, len(plane_ids) + revolution_of_quad]), 2)
    object_id = np.tile(np.concatenate([segment_of_quad, len(segments) + revolution_of_quad]), 2)
    ids = (object_id.astype(np.int32), primitive_id.astype(np.int32))
    return Labels(*ids, tuple(objects), tuple(primitives))


def segment_points(patches: Patches) -> tuple[Floats, Ints]:
    """Place points on all primitives, and divide them into segments.

    A segment is a group of planes that continue each other, or one surface of revolution.

    Returns
    -------
    xyz
        Points (m, 3) in the coordinates of the cloud.
    segments
        Index (m,) of the segment of each point.
    """
    xyz, leaf_of_point = reconstruct_planes(patches)
    leaf_segments = _merge_leaves(patches, xyz, leaf_of_point)
    plane_segments, segments = np.unique(leaf_segments[leaf_of_point], return_inverse=True)
    points, indices = [xyz], [segments]
    for k, revolution in enumerate(reconstruct_revolutions(patches), start=len(plane_segments)):
        points.append(revolution.xyz)
        indices.append(np.full(len(revolution.xyz), k))
    return np.concatenate(points), np.concatenate(indices)


def segment_leaves(patches: Patches) -> Ints:
    """Return for each leaf the index (n,) of one leaf that represents the whole segment."""
    return _merge_leaves(patches, *reconstruct_planes(patches))


def _merge_leaves(patches: Patches, xyz: Floats, leaf_of_point: Ints) -> Ints:
    moments = np.zeros((int(patches.octree.leaves.counts[0]), 10))
    centre = xyz.mean(axis=0) if len(xyz) else np.zeros(3)
    for first in range(0, len(xyz), _CHUNK):
        rows = slice(first, first + _CHUNK)
        point_moments = moments_of((xyz[rows] - centre) / patches.header.cell_size)
        np.add.at(moments, leaf_of_point[rows], point_moments)
    pairs = adjacent_leaves(patches.octree.leaves, patches.octree.geometry.shape)
    is_occupied = moments[:, 0] > 0
    pairs = pairs[is_occupied[pairs].all(axis=1)]
    limits = MergeLimits(0.0, _MAX_ADDED_ERROR, _MIN_COSINE)
    return np.asarray(merge_regions(moments, pairs, limits))


def _plane_primitives(header: SurfaceHeader, planes: Floats) -> list[Primitive]:
    offsets = planes[:, 3] * header.cell_size + planes[:, :3] @ header.origin
    normals = header.rotate_back(planes[:, :3])
    return [
        Primitive("plane", {"normal": normal.tolist(), "offset": float(offset)})
        for normal, offset in zip(normals, offsets, strict=True)
    ]


def _revolution_primitive(header: SurfaceHeader, surface: RevolutionSurface) -> Primitive:
    point = header.in_cloud(surface.origin[None])[0].tolist()
    axis = header.rotate_back(surface.axis[None])[0].tolist()
    radius = surface.radius * header.cell_size
    if surface.kind == SPHERE:
        return Primitive("sphere", {"centre": point, "radius": radius})
    if abs(surface.angle) < _MIN_CONE_ANGLE:
        return Primitive("cylinder", {"point": point, "axis": axis, "radius": radius})
    sign = float(np.sign(surface.angle))
    height = surface.radius / np.tan(surface.angle)
    apex = header.in_cloud((surface.origin - height * surface.axis)[None])[0].tolist()
    along = [sign * component for component in axis]
    return Primitive("cone", {"apex": apex, "axis": along, "half_angle": abs(surface.angle)})


@compiled
def _cover_with_rectangles(octree: PlaneOctree, quads: Floats, leaf_of_quad: Ints) -> int:
    """Write the corners (m, 4, 3) and leaf indices (m,) of rectangles over all occupied columns."""
    # Returns the number of rectangles, which may exceed m.
    leaves, count = octree.leaves, 0
    cell = np.zeros(3, np.int64)
    for i in range(leaves.counts[0]):
        plane_index, side = leaves.plane_index[i], leaves.side[i]
        axis = dominant_axis(leaves.planes[plane_index])
        low_u, low_v = leaves.corner[i, (axis + 1) % 3], leaves.corner[i, (axis + 2) % 3]
        remaining = np.zeros((side, side), np.uint8)
        for a in range(side):
            for b in range(side):
                if find_leaf_cell(octree, i, axis, low_u + a, low_v + b, cell):
                    remaining[a, b] = octree.occupancy[cell[0], cell[1], cell[2]] == OCCUPIED
        for a in range(side):
            for b in range(side):
                if remaining[a, b]:
                    end_a, end_b = _take_rectangle(remaining, a, b)
                    if count < len(quads):
                        u, v = (low_u + a, low_u + end_a), (low_v + b, low_v + end_b)
                        _write_corners(leaves.planes[plane_index], axis, u, v, quads[count])
                        leaf_of_quad[count] = i
                    count += 1
    return count


@compiled
def _take_rectangle(columns: Bytes, a: int, b: int) -> tuple[int, int]:
    """Set a rectangle of nonzero values to zero, and return its exclusive end."""
    end_b = b
    while end_b < columns.shape[1] and columns[a, end_b]:
        end_b += 1
    end_a = a
    while end_a < len(columns) and columns[end_a, b:end_b].all():
        columns[end_a, b:end_b] = 0
        end_a += 1
    return end_a, end_b


@compiled
def _write_corners(
    plane: Floats, axis: int, u: tuple[int, int], v: tuple[int, int], corners: Floats
) -> None:
    for k in range(4):
        p_u, p_v = u[1 if k in (1, 2) else 0], v[1 if k >= 2 else 0]
        corners[k, axis] = plane_height(plane, axis, p_u, p_v)
        corners[k, (axis + 1) % 3], corners[k, (axis + 2) % 3] = p_u, p_v

"""A light mesh of a stream: each leaf's columns as few rectangles on its plane, labelled by it."""

from __future__ import annotations

import numpy as np

from puckbench.codecs.primitives.decoder import Patches, read_patches
from puckbench.codecs.primitives.layout import (
    Bytes,
    Frame,
    Ints,
    Leaves,
    dominant,
    height,
)
from puckbench.codecs.primitives.manhattan_frame import rotation
from puckbench.codecs.primitives.revolved import SPHERE, Round, corners_of
from puckbench.codecs.primitives.segments import joined_leaves
from puckbench.codecs.primitives.stream import Header
from puckbench.codecs.primitives.support import in_leaf
from puckbench.core.compiling import compiled
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Labels, Mesh, Primitive, SceneObject

_STRAIGHT = 0.02
"""Angle of a cone, radians, below which it is called a cylinder."""


def decode_mesh(header: Header, bits: bytes) -> Mesh:
    """The surfaces of a stream as triangles in the cloud's coordinates.

    The primitive of a triangle is its plane (unit normal and offset, ``normal . p = offset``) or
    its cylinder, cone or sphere; its object the segment of leaves that go on from one another
    (`segments`), or the round surface. InputError when the stream is damaged or has no surface.
    """
    patches = read_patches(header, bits)
    surface = (patches.frame, patches.leaves, patches.cover)
    made = _rectangles(*surface, np.empty((0, 4, 3)), np.empty(0, np.int64))
    quads, rows = np.empty((made, 4, 3)), np.empty(made, np.int64)
    _rectangles(*surface, quads, rows)
    wraps = [corners_of(each, columns) for each, columns in patches.rounds]
    quads = np.concatenate([quads, *wraps])
    if not len(quads):
        raise InputError("the stream is damaged (it has no surface)")
    vertices = header.in_cloud(quads.reshape(-1, 3))
    corners = np.arange(4 * len(quads)).reshape(-1, 4)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return Mesh(vertices, triangles, _labels(patches, rows, [len(each) for each in wraps]))


def _labels(patches: Patches, rows: Ints, wraps: list[int]) -> Labels:
    """Labels of the triangles of rectangles on leaves `rows` and of columns of round surfaces."""
    used, named = np.unique(patches.leaves.plane[rows], return_inverse=True)
    segments, segment = np.unique(joined_leaves(patches)[rows], return_inverse=True)
    planes = patches.leaves.planes[used]
    offsets = planes[:, 3] * patches.header.unit + planes[:, :3] @ patches.header.origin
    normals = planes[:, :3] @ rotation(patches.header.turn)
    primitives = [
        Primitive("plane", {"normal": normal.tolist(), "offset": float(offset)})
        for normal, offset in zip(normals, offsets, strict=True)
    ]
    primitives += [_round_primitive(patches.header, each) for each, _ in patches.rounds]
    objects = [SceneObject(f"segment_{k + 1}", "segment") for k in range(len(segments))]
    objects += [SceneObject(f"round_{k + 1}", "round") for k in range(len(wraps))]
    number = np.repeat(np.arange(len(wraps)), wraps)
    primitive_id = np.tile(np.concatenate([named, len(used) + number]), 2)
    object_id = np.tile(np.concatenate([segment, len(segments) + number]), 2)
    ids = (object_id.astype(np.int32), primitive_id.astype(np.int32))
    return Labels(*ids, tuple(objects), tuple(primitives))


def _round_primitive(header: Header, surface: Round) -> Primitive:
    """Kind and numbers of a round surface in the cloud's coordinates."""
    point = header.in_cloud(surface.origin[None])[0].tolist()
    axis = (surface.axis @ rotation(header.turn)).tolist()
    radius = surface.radius * header.unit
    if surface.kind == SPHERE:
        return Primitive("sphere", {"centre": point, "radius": radius})
    if abs(surface.angle) < _STRAIGHT:
        return Primitive("cylinder", {"point": point, "axis": axis, "radius": radius})
    sign = float(np.sign(surface.angle))
    height = surface.radius / np.tan(surface.angle)
    apex = header.in_cloud((surface.origin - height * surface.axis)[None])[0].tolist()
    along = [sign * part for part in axis]
    return Primitive("cone", {"apex": apex, "axis": along, "half_angle": abs(surface.angle)})


@compiled
def _rectangles(frame: Frame, leaves: Leaves, cover: Bytes, quads: Floats, rows: Ints) -> int:
    """Corners of the rectangles of all leaves, and their leaves; how many, written or not."""
    count = 0
    at = np.zeros(3, np.int64)
    for i in range(leaves.counts[0]):
        name, side = leaves.plane[i], leaves.side[i]
        axis = dominant(leaves.planes[name])
        low_u, low_v = leaves.corner[i, (axis + 1) % 3], leaves.corner[i, (axis + 2) % 3]
        open_columns = np.zeros((side, side), np.uint8)
        for a in range(side):
            for b in range(side):
                if in_leaf(frame, leaves, i, axis, low_u + a, low_v + b, at):
                    open_columns[a, b] = cover[at[0], at[1], at[2]] == 2
        for a in range(side):
            for b in range(side):
                if open_columns[a, b]:
                    end_a, end_b = _take_rectangle(open_columns, a, b)
                    if count < len(quads):
                        u, v = (low_u + a, low_u + end_a), (low_v + b, low_v + end_b)
                        _write_corners(leaves.planes[name], axis, u, v, quads[count])
                        rows[count] = i
                    count += 1
    return count


@compiled
def _take_rectangle(columns: Bytes, a: int, b: int) -> tuple[int, int]:
    """Clear a rectangle of set columns that starts at (a, b); where it ends."""
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
        corners[k, axis] = height(plane, axis, p_u, p_v)
        corners[k, (axis + 1) % 3], corners[k, (axis + 2) % 3] = p_u, p_v

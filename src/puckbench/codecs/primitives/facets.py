"""A light mesh of a stream: each leaf's columns as few rectangles on its plane, labelled by it."""

from __future__ import annotations

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.primitives.decoder import Patches, read_patches
from puckbench.codecs.primitives.layout import (
    Bytes,
    Frame,
    Ints,
    Leaves,
    dominant,
    height,
)
from puckbench.codecs.primitives.segments import joined_leaves
from puckbench.codecs.primitives.stream import Header
from puckbench.codecs.primitives.support import in_leaf
from puckbench.compiling import compiled
from puckbench.errors import InputError
from puckbench.mesh import Labels, Mesh, Primitive, SceneObject


def decode_mesh(header: Header, bits: bytes) -> Mesh:
    """The planes of a stream as triangles in the cloud's coordinates.

    The primitive of a triangle is its plane (unit normal and offset, ``normal . p = offset``), its
    object the segment of leaves that go on from one another (`segments`).
    InputError when the stream is damaged or has no surface.
    """
    patches = read_patches(header, bits)
    surface = (patches.frame, patches.leaves, patches.cover)
    made = _rectangles(*surface, np.empty((0, 4, 3)), np.empty(0, np.int64))
    if not made:
        raise InputError("the stream is damaged (it has no surface)")
    quads, rows = np.empty((made, 4, 3)), np.empty(made, np.int64)
    _rectangles(*surface, quads, rows)
    vertices = quads.reshape(-1, 3) * header.unit + header.origin
    corners = np.arange(4 * made).reshape(-1, 4)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return Mesh(vertices, triangles, _labels(patches, np.tile(rows, 2)))


def _labels(patches: Patches, rows: Ints) -> Labels:
    """Labels of triangles on leaves `rows`: the plane as primitive, the segment as object."""
    used, named = np.unique(patches.leaves.plane[rows], return_inverse=True)
    segments, segment = np.unique(joined_leaves(patches)[rows], return_inverse=True)
    planes = patches.leaves.planes[used]
    offsets = planes[:, 3] * patches.header.unit + planes[:, :3] @ patches.header.origin
    primitives = tuple(
        Primitive("plane", {"normal": plane[:3].tolist(), "offset": float(offset)})
        for plane, offset in zip(planes, offsets, strict=True)
    )
    objects = tuple(SceneObject(f"segment_{k + 1}", "segment") for k in range(len(segments)))
    return Labels(segment.astype(np.int32), named.astype(np.int32), objects, primitives)


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

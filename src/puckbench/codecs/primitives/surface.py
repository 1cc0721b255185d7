"""Points on the planes of leaves, where the bitmaps say that there is surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.primitives.support import cell_of, dominant
from puckbench.codecs.primitives.walk import Frame, Leaves
from puckbench.metrics.compiled import compiled

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


@compiled
def count_points(frame: Frame, leaves: Leaves, cover: Bytes, fineness: int, spread: int) -> int:
    """Number of points that `fill` makes."""
    return int(fill(frame, leaves, cover, fineness, spread, np.empty((0, 3)), np.empty(0, np.int64)))


@compiled
def fill(
    frame: Frame,
    leaves: Leaves,
    cover: Bytes,
    fineness: int,
    spread: int,
    xyz: Floats,
    labels: Ints,
) -> int:
    """Write points on a grid over each leaf's columns and the rows of their planes; how many.

    A column has `fineness` x `fineness` points, or one in `spread` x `spread` columns has one.
    Points past the end of `xyz` are counted and not written.
    """
    count = 0
    for i in range(leaves.counts[0]):
        name = leaves.plane[i]
        plane, corner, side = leaves.planes[name], leaves.corner[i], leaves.side[i]
        axis = dominant(plane)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for a in range(side):
            for b in range(side):
                c_u, c_v = corner[u] + a, corner[v] + b
                if c_u % spread != spread // 2 or c_v % spread != spread // 2:
                    continue
                if not _covered(frame, plane, axis, c_u, c_v, corner[axis], side, cover):
                    continue
                for k in range(fineness * fineness):
                    p_u = (c_u + (k % fineness + 0.5) / fineness) * frame.cell
                    p_v = (c_v + (k // fineness + 0.5) / fineness) * frame.cell
                    if count < len(xyz):
                        height = (plane[3] - plane[u] * p_u - plane[v] * p_v) / plane[axis]
                        xyz[count, axis], xyz[count, u], xyz[count, v] = height, p_u, p_v
                        labels[count] = name
                    count += 1
    return count


@compiled
def _covered(
    frame: Frame, plane: Floats, axis: int, a: int, b: int, low: int, side: int, cover: Bytes
) -> bool:
    """Whether a column of a leaf is surface: its plane crosses it within the leaf and its bit is set."""
    at = np.zeros(3, np.int64)
    if not cell_of(frame, plane, axis, a, b, at):
        return False
    return bool(low <= at[axis] < low + side and cover[at[0], at[1], at[2]] == 2)

"""Points on the planes of leaves, where the bitmaps say that there is surface."""

from __future__ import annotations

import numpy as np

from puckbench.codecs.primitives.layout import Bytes, Frame, Ints, Leaves, dominant, height
from puckbench.codecs.primitives.support import in_leaf
from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats


@compiled
def count_points(frame: Frame, leaves: Leaves, cover: Bytes, fineness: int, spread: int) -> int:
    """Number of points that `fill` makes."""
    nothing = np.empty((0, 3)), np.empty(0, np.int64)
    return int(fill(frame, leaves, cover, fineness, spread, nothing[0], nothing[1]))


@compiled
def fill(
    frame: Frame,
    leaves: Leaves,
    cover: Bytes,
    fineness: int,
    spread: int,
    xyz: Floats,
    rows: Ints,
) -> int:
    """Write points on a grid over each leaf's columns, and the leaves they lie on; how many.

    A column has `fineness` x `fineness` points, or one in `spread` x `spread` columns has one.
    Points past the end of `xyz` are counted and not written.
    """
    count = 0
    at = np.zeros(3, np.int64)
    for i in range(leaves.counts[0]):
        axis = dominant(leaves.planes[leaves.plane[i]])
        low_u, low_v = leaves.corner[i, (axis + 1) % 3], leaves.corner[i, (axis + 2) % 3]
        for a in range(low_u, low_u + leaves.side[i]):
            for b in range(low_v, low_v + leaves.side[i]):
                if a % spread != spread // 2 or b % spread != spread // 2:
                    continue
                if in_leaf(frame, leaves, i, axis, a, b, at) and cover[at[0], at[1], at[2]] == 2:
                    _fill_column(leaves, i, (axis, a, b), fineness, xyz[count:], rows[count:])
                    count += fineness * fineness
    return count


@compiled
def _fill_column(
    leaves: Leaves, i: int, column: tuple[int, int, int], fineness: int, xyz: Floats, rows: Ints
) -> None:
    axis, a, b = column
    for k in range(min(fineness * fineness, len(xyz))):
        u = a + (k % fineness + 0.5) / fineness
        v = b + (k // fineness + 0.5) / fineness
        xyz[k, axis] = height(leaves.planes[leaves.plane[i]], axis, u, v)
        xyz[k, (axis + 1) % 3], xyz[k, (axis + 2) % 3] = u, v
        rows[k] = i

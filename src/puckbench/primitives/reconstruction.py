"""Reconstruction of points on a regular grid over the occupied columns of planes."""

from __future__ import annotations

import numpy as np

from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats
from puckbench.primitives.occupancy_map import find_leaf_cell
from puckbench.primitives.octree_arrays import (
    OCCUPIED,
    Bytes,
    Ints,
    Leaves,
    OctreeGeometry,
    dominant_axis,
    plane_height,
)


@compiled
def count_points(
    geometry: OctreeGeometry,
    leaves: Leaves,
    occupancy: Bytes,
    points_across: int,
    column_spacing: int,
) -> int:
    no_points = np.empty((0, 3)), np.empty(0, np.int64)
    return int(
        reconstruct_points(
            geometry, leaves, occupancy, points_across, column_spacing, no_points[0], no_points[1]
        )
    )


@compiled
def reconstruct_points(
    geometry: OctreeGeometry,
    leaves: Leaves,
    occupancy: Bytes,
    points_across: int,
    column_spacing: int,
    xyz: Floats,
    leaf_of_point: Ints,
) -> int:
    """Write the points of all occupied columns as far as the arrays allow; return their number.

    Each column has points_across x points_across points, or, if points_across is 1, one of
    column_spacing x column_spacing columns has a point. The outputs are `xyz` (m, 3), and the
    leaves' indices `leaf_of_point` (m,).
    """
    count = 0
    cell = np.zeros(3, np.int64)
    for i in range(leaves.counts[0]):
        axis = dominant_axis(leaves.planes[leaves.plane_index[i]])
        low_u, low_v = leaves.corner[i, (axis + 1) % 3], leaves.corner[i, (axis + 2) % 3]
        for a in range(low_u, low_u + leaves.side[i]):
            for b in range(low_v, low_v + leaves.side[i]):
                if (
                    a % column_spacing != column_spacing // 2
                    or b % column_spacing != column_spacing // 2
                ):
                    continue
                if (
                    find_leaf_cell(geometry, leaves, i, axis, a, b, cell)
                    and occupancy[cell[0], cell[1], cell[2]] == OCCUPIED
                ):
                    _reconstruct_column(
                        leaves, i, (axis, a, b), points_across, xyz[count:], leaf_of_point[count:]
                    )
                    count += points_across * points_across
    return count


@compiled_in_place
def _reconstruct_column(
    leaves: Leaves,
    i: int,
    column: tuple[int, int, int],
    points_across: int,
    xyz: Floats,
    leaf_of_point: Ints,
) -> None:
    axis, a, b = column
    for k in range(min(points_across * points_across, len(xyz))):
        u = a + (k % points_across + 0.5) / points_across
        v = b + (k // points_across + 0.5) / points_across
        xyz[k, axis] = plane_height(leaves.planes[leaves.plane_index[i]], axis, u, v)
        xyz[k, (axis + 1) % 3], xyz[k, (axis + 2) % 3] = u, v
        leaf_of_point[k] = i

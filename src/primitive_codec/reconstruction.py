from __future__ import annotations

from typing import Any

import numpy as np

from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats
from primitive_codec.occupancy_map import find_leaf_cell
from primitive_codec.octree_arrays import (
    OCCUPIED,
    Ints,
    Leaves,
    PlaneOctree,
    dominant_axis,
    plane_height,
)
from primitive_codec.stream import SPACING_UNIT


@compiled
def count_points(octree: PlaneOctree, spacing: int) -> int:
    return int(reconstruct_points(octree, spacing, np.empty((0, 3)), np.empty(0, np.int64)))


@compiled
def first_point(column: Any, spacing: int) -> Any:
    """Return the index of a row's first point in or after `column`, which may be an array.

    Point i lies at (i + 1/2) * spacing / `SPACING_UNIT` columns.
    """
    return (2 * SPACING_UNIT * column + spacing - 1) // (2 * spacing)


@compiled
def reconstruct_points(octree: PlaneOctree, spacing: int, xyz: Floats, leaf_of_point: Ints) -> int:
    """Write points of a square grid on the occupied columns; return their number.

    Points are `spacing` / `SPACING_UNIT` columns apart. Their number may exceed the length m of
    `xyz` (m, 3) and of the leaf indices `leaf_of_point` (m,).
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

"""Arrays of the octree that both the encoder and the decoder use.

Lengths are in cells, which are nodes of the finest level. A column of an occupancy map is one cell
wide.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats

Ints = NDArray[np.int64]
IndexGrid = NDArray[np.int32]
"""Grid whose cells hold 1 + an index, or 0 for no index."""
Bytes = NDArray[np.uint8]

SPACING_UNIT = 2048
"""Number of steps of point spacing per column."""
UNKNOWN, EMPTY, OCCUPIED = 0, 1, 2
"""State of a column, stored in the cell where the column crosses a plane."""


class OctreeGeometry(NamedTuple):
    """Sizes and levels of the octree.

    Level 0 is the root. The side of a node is 2^(depth - level) cells.
    """

    depth: int  # level of the cells
    finest_leaf_level: int  # of the smallest leaves
    coarsest_leaf_level: int  # of the largest leaves
    shape: Ints  # (3,) cells along each axis
    plane_steps: Floats  # (depth + 1,) quantisation step of planes by level, in cells
    lmbda: float  # Lagrangian weight in squared cells per bit (encoder only)


class Leaves(NamedTuple):
    """The leaves of the octree with their planes, of which several leaves can share one."""

    corner: Ints  # (n, 3)
    side: Ints  # (n,)
    plane_index: Ints  # (n,)
    planes: Floats  # (n, 4) unit normal n and offset d, n . p = d
    counts: Ints  # (2,) numbers of leaves and of planes


class PlaneOctree(NamedTuple):
    """An octree of planes, which is filled while it is encoded or decoded."""

    geometry: OctreeGeometry
    leaves: Leaves
    leaf_grid: IndexGrid  # grid of the smallest leaves with the leaves' indices
    occupancy: Bytes  # grid of cells with the states of the planes' columns


class EncoderNodes(NamedTuple):
    """All octree nodes, level by level, which only the encoder knows."""

    moments: Floats  # (n, 10) of the samples in the node
    first_child: Ints  # (n + 1,) index of the first child
    is_leaf: NDArray[np.bool_]  # (n,)
    octant: Ints  # (n,) position within the parent
    region_moments: Floats  # (n, 10) of the region that a leaf belongs to


@compiled_in_place
def leaf_at(octree: PlaneOctree, x: int, y: int, z: int) -> int:
    """Return 1 + the index of the leaf that contains cell (x, y, z), or 0 if there is none."""
    side_log2 = octree.geometry.depth - octree.geometry.finest_leaf_level
    return int(octree.leaf_grid[x >> side_log2, y >> side_log2, z >> side_log2])


@compiled_in_place
def dominant_axis(plane: Floats) -> int:
    """Return the axis (0, 1 or 2) nearest to the normal of a plane (4,).

    Columns of the plane's occupancy map run along this axis.
    """
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    return axis


@compiled_in_place
def plane_height(plane: Floats, axis: int, u: float, v: float) -> float:
    """Return the coordinate of a plane along an axis, at a position on the other two axes.

    Parameters
    ----------
    plane
        Unit normal and offset (4,).
    axis
        Axis along which the coordinate is measured.
    u, v
        Coordinates along the axes (axis + 1) % 3 and (axis + 2) % 3.
    """
    across = plane[(axis + 1) % 3] * u + plane[(axis + 2) % 3] * v
    return float((plane[3] - across) / plane[axis])


@compiled
def first_point(column: Any, spacing: int) -> Any:
    """Return the index of the first point of a row that lies in or after a column.

    Point i of a row lies at (i + 1/2) * spacing / `SPACING_UNIT` columns.

    Parameters
    ----------
    column
        Index of the column, or an array of indices.
    spacing
        Distance between adjacent points, in columns / `SPACING_UNIT`.
    """
    return (2 * SPACING_UNIT * column + spacing - 1) // (2 * spacing)

"""Arrays of the octree that encoder and decoder share.

Lengths are in cells (nodes of the finest level). A column of an occupancy map is one cell wide.
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
    """Geometry of the octree: level 0 is the root; a node's side is 2^(depth - level) cells."""

    depth: int  # level of the cells
    finest_leaf_level: int  # of the smallest leaves
    coarsest_leaf_level: int  # of the largest leaves
    shape: Ints  # (3,) cells along each axis
    plane_steps: Floats  # (depth + 1,) quantisation step of planes by level, in cells
    lmbda: float  # Lagrangian weight in squared cells per bit (encoder only)


class Leaves(NamedTuple):
    corner: Ints  # (n, 3)
    side: Ints  # (n,)
    plane_index: Ints  # (n,)
    planes: Floats  # (n, 4) unit normal n and offset d, n . p = d
    counts: Ints  # (2,) numbers of leaves and of planes


class PlaneOctree(NamedTuple):
    """An octree of planes, filled in while it is coded."""

    geometry: OctreeGeometry
    leaves: Leaves
    leaf_grid: IndexGrid  # grid of the smallest leaves with the leaves' indices
    occupancy: Bytes  # grid of cells with the states of the planes' columns


class EncoderNodes(NamedTuple):
    """Octree nodes, level by level, known to the encoder only."""

    moments: Floats  # (n, 10) of the samples in the node
    first_child: Ints  # (n + 1,) index of the first child
    is_leaf: NDArray[np.bool_]  # (n,)
    octant: Ints  # (n,) position within the parent
    region_moments: Floats  # (n, 10) of the region that a leaf belongs to


@compiled_in_place
def leaf_at(octree: PlaneOctree, x: int, y: int, z: int) -> int:
    """Return 1 + the index of the leaf that contains a cell, or 0 if no leaf does."""
    side_log2 = octree.geometry.depth - octree.geometry.finest_leaf_level
    return int(octree.leaf_grid[x >> side_log2, y >> side_log2, z >> side_log2])


@compiled_in_place
def dominant_axis(plane: Floats) -> int:
    """Return the axis nearest to a plane's normal, along which columns of occupancy maps run."""
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    return axis


@compiled_in_place
def plane_height(plane: Floats, axis: int, u: float, v: float) -> float:
    """Return a plane's coordinate along `axis` at coordinates u and v along the next two axes."""
    across = plane[(axis + 1) % 3] * u + plane[(axis + 2) % 3] * v
    return float((plane[3] - across) / plane[axis])


@compiled
def first_point(column: Any, spacing: int) -> Any:
    """Return the index of a row's first point in or after `column`, which may be an array.

    Point i lies at (i + 1/2) * spacing / `SPACING_UNIT` columns.
    """
    return (2 * SPACING_UNIT * column + spacing - 1) // (2 * spacing)

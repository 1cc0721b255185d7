"""Arrays of the octree that encoder and decoder share. All lengths are in cells.

A cell is a node of the finest level. A column of an occupancy map is one cell wide.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled_in_place
from puckbench.geometry.cloud import Floats

Ints = NDArray[np.int64]
IndexGrid = NDArray[np.int32]
"""Grid of 1 + index, 0 for none."""
Bytes = NDArray[np.uint8]

UNKNOWN, EMPTY, OCCUPIED = 0, 1, 2
"""State of a column, stored in the cell where the column crosses a plane."""


class OctreeGeometry(NamedTuple):
    """Geometry of the octree: level 0 is the root, a node's side is 2^(depth - level) cells.

    depth: level of the cells. finest_leaf_level, coarsest_leaf_level: levels of the smallest and
    largest leaves. shape: (3,) cells along each axis. plane_steps: (depth + 1,) quantisation step
    of the planes of each level's leaves, in cells. lmbda: Lagrangian weight in squared cells per
    bit (encoder only).
    """

    depth: int
    finest_leaf_level: int
    coarsest_leaf_level: int
    shape: Ints
    plane_steps: Floats
    lmbda: float


class Leaves(NamedTuple):
    """Leaves in coding order: corner (n, 3), side (n,) in cells, and index (n,) of the plane.

    planes: (n, 4) unit normal n and offset d, n . p = d. counts: (2,) number of leaves and of
    planes.
    """

    corner: Ints
    side: Ints
    plane_index: Ints
    planes: Floats
    counts: Ints


class EncoderNodes(NamedTuple):
    """Nodes of all levels, one level after the other, known to the encoder only.

    moments: (n, 10) of the samples in the node. first_child: (n + 1,) index of the first child.
    is_leaf: (n,). octant: (n,) position within the parent. region_moments: (n, 10) moments of the
    region that a leaf belongs to.
    """

    moments: Floats
    first_child: Ints
    is_leaf: NDArray[np.bool_]
    octant: Ints
    region_moments: Floats


@compiled_in_place
def leaf_at(geometry: OctreeGeometry, leaf_grid: IndexGrid, x: int, y: int, z: int) -> int:
    """Return 1 + the index of the leaf that contains a cell, 0 if there is none.

    leaf_grid: grid with the cell size of the smallest leaves.
    """
    side_log2 = geometry.depth - geometry.finest_leaf_level
    return int(leaf_grid[x >> side_log2, y >> side_log2, z >> side_log2])


@compiled_in_place
def dominant_axis(plane: Floats) -> int:
    """Return the axis nearest to a plane's normal. The plane's columns run along it."""
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    return axis


@compiled_in_place
def plane_height(plane: Floats, axis: int, u: float, v: float) -> float:
    """Return the coordinate of a plane along `axis` where the next two axes have the values u and
    v.
    """
    across = plane[(axis + 1) % 3] * u + plane[(axis + 2) % 3] * v
    return float((plane[3] - across) / plane[axis])

"""Arrays of the octree of planes that encoder and decoder share: geometry, leaves, nodes.

All lengths are in finest cells, the columns of the occupancy maps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled_in_place
from puckbench.geometry.cloud import Floats

Ints = NDArray[np.int64]
LeafMap = NDArray[np.int32]
Bytes = NDArray[np.uint8]

UNKNOWN, EMPTY, OCCUPIED = 0, 1, 2
"""States of a column, kept in the grid of the cells where columns cross planes."""


class OctreeGeometry(NamedTuple):
    """Geometry of the octree: level 0 is the root, a node's side is 2^(depth - level) cells.

    depth: level of the cells. finest_leaf_level, coarsest_leaf_level: of the smallest and largest
    leaves. shape: (3,) cells along each axis. plane_steps: (depth + 1,) quantisation step of the
    planes of each level's leaves, in cells. lmbda: Lagrangian weight, in squared cells for a bit
    (encoder only).
    """

    depth: int
    finest_leaf_level: int
    coarsest_leaf_level: int
    shape: Ints
    plane_steps: Floats
    lmbda: float


class Leaves(NamedTuple):
    """Leaves in coding order: corner (n, 3), side (n,) in cells, and index (n,) of the plane.

    planes: (n, 4) unit normal and offset, n . p = d. counts: (2,) leaves and planes so far.
    """

    corner: Ints
    side: Ints
    plane_index: Ints
    planes: Floats
    counts: Ints


class Nodes(NamedTuple):
    """Nodes of all levels as the encoder knows them, one level after the other.

    moments: (n, 10) of the samples. first_child: (n + 1,) index in this list. is_leaf: (n,).
    octant: (n,) place within the parent. region_moments: (n, 10) of the region that a leaf is in.
    """

    moments: Floats
    first_child: Ints
    is_leaf: NDArray[np.bool_]
    octant: Ints
    region_moments: Floats


@compiled_in_place
def leaf_at(geometry: OctreeGeometry, leaf_map: LeafMap, x: int, y: int, z: int) -> int:
    """Index + 1 of the leaf that a cell belongs to, 0 for none.

    leaf_map: grid at the size of the smallest leaves.
    """
    down = geometry.depth - geometry.finest_leaf_level
    return int(leaf_map[x >> down, y >> down, z >> down])


@compiled_in_place
def dominant_axis(plane: Floats) -> int:
    """The axis nearest to a plane's normal, along which its columns run."""
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    return axis


@compiled_in_place
def plane_height(plane: Floats, axis: int, u: float, v: float) -> float:
    """Coordinate of a plane along `axis` where the next two axes' coordinates are u and v."""
    across = plane[(axis + 1) % 3] * u + plane[(axis + 2) % 3] * v
    return float((plane[3] - across) / plane[axis])

"""What the steps of coding share: the tree's geometry, its leaves, what the encoder knows.

All lengths are in finest cells, the columns of the bitmaps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats

Ints = NDArray[np.int64]
Owners = NDArray[np.int32]
Bytes = NDArray[np.uint8]


class Frame(NamedTuple):
    """Geometry of the tree. Level 0 is the root; a node's side at a level is 2^(depth - level).

    depth: level of the cells. finest, coarsest: levels of the least and the largest leaves.
    shape: (3,) cells along each axis. steps: (depth + 1,) precision of a plane's numbers by level.
    price: squared error that a bit may save (encoder).
    """

    depth: int
    finest: int
    coarsest: int
    shape: Ints
    steps: Floats
    price: float


class Leaves(NamedTuple):
    """Leaves in the order of coding: corner (n, 3) and side (n,) in cells, plane (n,) index.

    planes: (n, 4), n.p = d, |n| = 1. counts: (2,) how many leaves and planes there are so far.
    """

    corner: Ints
    side: Ints
    plane: Ints
    planes: Floats
    counts: Ints


class Nodes(NamedTuple):
    """What the encoder knows of the nodes of all levels, one level after the other.

    moments: (n, 10). first: (n + 1,) children's place in the list. leaf: (n,). octant: (n,) of a
    node in its parent. wholes: (n, 10) moments of the region that a leaf is in.
    """

    moments: Floats
    first: Ints
    leaf: NDArray[np.bool_]
    octant: Ints
    wholes: Floats


@compiled_in_place
def owner_at(frame: Frame, owner: Owners, x: int, y: int, z: int) -> int:
    """The leaf that has a cell and 1, or 0, in the grid of least leaves."""
    down = frame.depth - frame.finest
    return int(owner[x >> down, y >> down, z >> down])


@compiled
def dominant(plane: Floats) -> int:
    """The axis that a plane's normal is nearest to."""
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    return axis


@compiled
def height(plane: Floats, axis: int, u: float, v: float) -> float:
    """Coordinate of a plane along `axis` where the next two axes' coordinates are u and v."""
    across = plane[(axis + 1) % 3] * u + plane[(axis + 2) % 3] * v
    return float((plane[3] - across) / plane[axis])

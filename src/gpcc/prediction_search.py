"""Search for nearest positions in a growing set, with k-d trees whose sizes are powers of two.

A new position and all trees below the smallest unused size are merged into a tree of this size
(Bentley's logarithmic method), as in TMC13.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gpcc.compiled import kernel
from gpcc.kd_tree import Int32s, KdTrees, build, empty_trees, search, search_rows
from pointkit.geometry.morton import Ints

NEIGHBOURS = 3
_LEAF_LOG2 = 3
"""Up to 2^3 positions are searched without a tree."""
_FAR = (1 << 62) - 1


class Search(NamedTuple):
    """K-d trees; the tree of 2^k positions starts at the row 2^k and the node 2^(k + 1).

    owners: (n,) node that predicts each position.
    boxes: (m, 6) bounding boxes of the trees.
    """

    trees: KdTrees
    owners: Int32s
    boxes: Ints
    counters: Ints


def empty_search(most: int) -> Search:
    count = max(most, 1).bit_length()
    positions = np.empty((most, 3), dtype=np.int32)
    return Search(
        empty_trees(positions, 2 << count, 4 << count, NEIGHBOURS),
        np.empty(most, dtype=np.int32),
        np.empty((count, 6), dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )


@kernel
def add_position(forest: Search, owner: int, x: int, y: int, z: int) -> None:
    row, rows, positions = forest.counters[0], forest.trees.rows, forest.trees.points
    positions[row, 0], positions[row, 1], positions[row, 2] = x, y, z
    forest.owners[row] = owner
    tree = 0
    while row >> tree & 1:
        tree += 1
    size = 1 << tree
    for k in range(1, size):  # the rows of all smaller trees
        rows[size + k - 1] = rows[k]
    rows[2 * size - 1] = row
    forest.counters[0] += 1
    if tree > _LEAF_LOG2:
        build(forest.trees, 2 * size, size, 2 * size, forest.boxes[tree], 1.0)


@kernel
def nearest(forest: Search, x: int, y: int, z: int) -> int:
    """Write the positions nearest to a point, at most 3, to `trees.nearest`; return the number."""
    held, count, tree = 0, forest.counters[0], 0
    forest.trees.distances[NEIGHBOURS - 1] = _FAR
    while count >> tree:
        if count >> tree & 1 and tree <= _LEAF_LOG2:
            held = search_rows(forest.trees, 1 << tree, 2 << tree, (x, y, z), held)
        elif count >> tree & 1:
            held = search(forest.trees, 2 << tree, forest.boxes[tree], (x, y, z), held)
        tree += 1
    return held

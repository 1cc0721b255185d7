"""Prediction trees of a slice's points: the order and the parents of points, chosen as in TMC13.

With a sensor, each laser's points form a chain, and chains are linked by their first points.
Without a sensor, the parent of a point is the node with the nearest prediction.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from gpcc.azimuth_order import azimuth_order
from gpcc.compiled import entry, integer, kernel, row
from gpcc.kd_tree import Int32s, KdTrees, build, build_in_threads, empty_trees, search, search_rows
from gpcc.spherical import Sphere, spherical
from pointkit.geometry.morton import Ints, morton_codes

Order = Literal["given", "morton", "azimuth", "radius"]

MOST_CHILDREN = 3
ROOT, DUPLICATE = -1, -2
"""Values in place of a parent, for the root of a tree and for a duplicate of the previous point."""
NEIGHBOURS = 3
_LEAF_LOG2 = 3
"""Up to 2^3 positions are searched without a tree."""
_LARGE_LOG2 = 15
"""Trees of at least 2^15 positions are built in threads."""
_FAR = (1 << 62) - 1


class PredictionTree(NamedTuple):
    """Trees whose nodes are the points (n,) of a slice; ancestors predict each point."""

    # Index of the parent, ROOT or DUPLICATE.
    parents: Int32s
    # (n, 3) indices; the first `num_children` are valid.
    children: Int32s
    num_children: Int32s
    # Number of duplicates that follow the node.
    copies: Int32s


def ordered(points: Int32s, order: Order, centre: tuple[int, int, int], precision: float) -> Ints:
    """Return the indices (n,) that bring points into the order in which trees are built.

    Parameters
    ----------
    points
        Integer coordinates (n, 3).
    order
        Criterion by which points are sorted.
    centre
        Point around which azimuth and radius are measured.
    precision
        Azimuth steps per radian, or 0 for exact azimuths.
    """
    if order == "given":
        return np.arange(len(points))
    if order == "morton":
        low = points.min(axis=0)
        return np.argsort(
            morton_codes((points - low).astype(np.int64), np.arange(3)), kind="stable"
        )
    around = points.astype(np.int64) - centre
    if order == "radius":
        return np.argsort(around[:, 0] ** 2 + around[:, 1] ** 2, kind="stable")
    return azimuth_order(around, precision)


def empty_tree(points: int) -> PredictionTree:
    return PredictionTree(
        np.full(points, ROOT, dtype=np.int32),
        np.empty((points, MOST_CHILDREN), dtype=np.int32),
        np.zeros(points, dtype=np.int32),
        np.zeros(points, dtype=np.int32),
    )


def angular_tree(points: Int32s, around: Sphere, positions: Int32s, most: int) -> PredictionTree:
    tree = empty_tree(len(points))
    for start in range(0, len(points), most):
        lasers = np.full((2, len(around.theta)), ROOT, dtype=np.int32)
        _chain(points, around, positions, tree, lasers, start, min(start + most, len(points)))
    return tree


@entry
def _chain(
    points: Int32s,
    around: Sphere,
    positions: Int32s,
    tree: PredictionTree,
    lasers: Int32s,
    node: int,
    end: int,
) -> None:
    """Build a tree of the points `node` to `end` - 1."""
    # lasers: (2, number of lasers) first and last point of each laser.
    ox, oy, oz = around.origin
    while node < end:
        x, y, z = row(points, node)
        position = spherical(around, x - ox, y - oy, z - oz)
        _find_copies(points, tree, node, end)
        for k in range(node, node + 1 + tree.copies[node]):
            for axis in range(3):
                positions[k, axis] = position[axis]
        laser = position[2]
        if lasers[1, laser] == ROOT:
            lasers[0, laser] = node
        else:
            _hang(tree, node, integer(lasers[1, laser]))
        lasers[1, laser] = node
        node += 1 + tree.copies[node]
    before = -1
    for laser in range(lasers.shape[1]):
        first = integer(lasers[0, laser])
        if first >= 0:
            if before >= 0 and tree.num_children[before] < MOST_CHILDREN:
                _hang(tree, first, before)
            before = first


def nearest_tree(points: Int32s, most: int) -> PredictionTree:
    tree = empty_tree(len(points))
    for start in range(0, len(points), most):
        end = min(start + most, len(points))
        forest, node = empty_forest(3 * (end - start)), start
        while node < end:
            node = _grow(points, tree, forest, node, end)
            if large := int(forest.counters[1]):
                size = 1 << large
                build_in_threads(forest.trees, size, 2 * size, forest.boxes[large], 1.0)
                forest.counters[1] = 0
    return tree


@entry
def _grow(points: Int32s, tree: PredictionTree, forest: Forest, node: int, end: int) -> int:
    """Add nodes until a large tree of the forest is to be built, and return the next node."""
    while node < end and not forest.counters[1]:
        _find_copies(points, tree, node, end)
        x, y, z = row(points, node)
        for k in range(nearest(forest, x, y, z)):
            parent = integer(forest.owners[forest.trees.nearest[k]])
            if tree.num_children[parent] < MOST_CHILDREN:
                _hang(tree, node, parent)
                break
        _add_predictions(points, tree, forest, node)
        node += 1 + integer(tree.copies[node])
    return node


@kernel
def _add_predictions(points: Int32s, tree: PredictionTree, forest: Forest, node: int) -> None:
    x, y, z = row(points, node)
    add_position(forest, node, x, y, z)
    parent = integer(tree.parents[node])
    if parent < 0:
        return
    a, b, c = row(points, parent)
    add_position(forest, node, 2 * x - a, 2 * y - b, 2 * z - c)
    before = integer(tree.parents[parent])
    if before >= 0:
        x, y, z = x + a - points[before, 0], y + b - points[before, 1], z + c - points[before, 2]
        add_position(forest, node, x, y, z)


@kernel
def _find_copies(points: Int32s, tree: PredictionTree, node: int, end: int) -> None:
    k = node + 1
    while (
        k < end
        and points[k, 0] == points[node, 0]
        and points[k, 1] == points[node, 1]
        and points[k, 2] == points[node, 2]
    ):
        tree.parents[k] = DUPLICATE
        k += 1
    tree.copies[node] = k - node - 1


@kernel
def _hang(tree: PredictionTree, node: int, parent: int) -> None:
    tree.parents[node] = parent
    tree.children[parent, tree.num_children[parent]] = node
    tree.num_children[parent] += 1


class Forest(NamedTuple):
    """K-d trees with 2^k positions each, to which positions are added one by one, as in TMC13.

    A new position and all trees below the smallest unused size are merged into a tree of this size
    (Bentley's logarithmic method). The tree of 2^k positions starts at the row 2^k.
    """

    trees: KdTrees
    # (n,) node that predicts each position.
    owners: Int32s
    # (m, 6) bounding boxes of the trees.
    boxes: Ints
    # Number of positions, and log2 of the size of a tree that is to be built, or 0.
    counters: Ints


def empty_forest(most: int) -> Forest:
    count = max(most, 1).bit_length()
    return Forest(
        empty_trees(np.int32, 2 << count, NEIGHBOURS),
        np.empty(most, dtype=np.int32),
        np.empty((count, 6), dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )


@kernel
def add_position(forest: Forest, owner: int, x: int, y: int, z: int) -> None:
    row, rows, places = forest.counters[0], forest.trees.rows, forest.trees.places
    forest.owners[row] = owner
    tree = 0
    while row >> tree & 1:
        tree += 1
    size = 1 << tree
    for k in range(1, size):  # the rows of all smaller trees
        rows[size + k - 1] = rows[k]
        for axis in range(3):
            places[axis, size + k - 1] = places[axis, k]
    rows[2 * size - 1] = row
    places[0, 2 * size - 1], places[1, 2 * size - 1], places[2, 2 * size - 1] = x, y, z
    forest.counters[0] += 1
    if tree >= _LARGE_LOG2:  # needed after two more positions at most, which leave it as it is
        forest.counters[1] = tree
    elif tree > _LEAF_LOG2:
        build(forest.trees, size, 2 * size, forest.boxes[tree], 1.0)


@kernel
def nearest(forest: Forest, x: int, y: int, z: int) -> int:
    """Find the positions nearest to a place, and return how many were found (at most three).

    The positions are written to `forest.trees.nearest`.
    """
    held, count, tree = 0, forest.counters[0], 0
    forest.trees.distances[NEIGHBOURS - 1] = _FAR
    while count >> tree:
        if count >> tree & 1 and tree <= _LEAF_LOG2:
            held = search_rows(forest.trees, 1 << tree, 2 << tree, (x, y, z), held)
        elif count >> tree & 1:
            held = search(forest.trees, 1 << tree, forest.boxes[tree], (x, y, z), held)
        tree += 1
    return held

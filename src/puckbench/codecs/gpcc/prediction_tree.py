"""Prediction trees of an encoder: the order of a slice's points, and each one's parent.

With a sensor every laser's points are a chain, whose first points hang on each other. Without, the
parent of a point is the one whose predictions come nearest. Orders and trees are those that the
reference software builds.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.gpcc.compiled import entry, integer
from puckbench.codecs.gpcc.prediction_search import Search, add_position, empty_search, nearest
from puckbench.codecs.gpcc.spherical import Sphere, spherical, wrapped
from puckbench.geometry.morton import Ints, codes

Int32s = NDArray[np.int32]
Order = Literal["given", "morton", "azimuth", "radius"]

MOST_CHILDREN = 3
ROOT, DUPLICATE = -1, -2
"""In place of a parent: a tree's root; a point that coincides with the one before."""


class PredictionTree(NamedTuple):
    """Nodes (n,), one for each point, in the order of coding's input.

    parents: row of the parent, or ROOT or DUPLICATE. children: (n, 3) rows, of which the first
    `num_children` count. copies: how many points after this one coincide with it.
    """

    parents: Int32s
    children: Int32s
    num_children: Int32s
    copies: Int32s


def ordered(points: Int32s, order: Order, centre: tuple[int, int, int], precision: float) -> Ints:
    """Rows (n,) of points (n, 3) in the order in which a tree is built.

    centre: around which azimuth and radius are. precision: steps of the azimuth in a radian, within
    which the radius orders; 0 for none.
    """
    if order == "given":
        return np.arange(len(points))
    if order == "morton":
        low = points.min(axis=0)
        return np.argsort(codes((points - low).astype(np.int64), np.arange(3)), kind="stable")
    around = points.astype(np.int64) - centre
    if order == "radius":
        return np.argsort(around[:, 0] ** 2 + around[:, 1] ** 2, kind="stable")
    azimuth, radius, slope = np.empty((3, len(points)))
    _polar(around, precision, azimuth, radius, slope)
    return np.lexsort((slope, radius, azimuth))


@entry
def _polar(
    around: Ints,
    precision: float,
    azimuth: NDArray[np.float64],
    radius: NDArray[np.float64],
    slope: NDArray[np.float64],
) -> None:
    for i in range(len(around)):
        x, y, z = around[i]
        angle = math.atan2(y, x)
        if precision:
            steps = math.floor(abs(angle * precision) + 0.5)
            angle = -steps if angle < 0 else steps
        azimuth[i] = angle
        radius[i] = math.hypot(x, y)
        slope[i] = z / radius[i]


def empty_tree(points: int) -> PredictionTree:
    """Room for the nodes of so many points, none of which has a child yet."""
    return PredictionTree(
        np.full(points, ROOT, dtype=np.int32),
        np.empty((points, MOST_CHILDREN), dtype=np.int32),
        np.zeros(points, dtype=np.int32),
        np.zeros(points, dtype=np.int32),
    )


def angular_tree(points: Int32s, around: Sphere, positions: Int32s) -> PredictionTree:
    """The tree of a sensor's points (n, 3); `positions` (n, 3) become their spherical coordinates.

    points: from the slice's origin.
    """
    tree = empty_tree(len(points))
    lasers = np.full((2, len(around.theta)), ROOT, dtype=np.int32)
    _chain(points, around, positions, tree, lasers)
    return tree


@entry
def _chain(
    points: Int32s, around: Sphere, positions: Int32s, tree: PredictionTree, lasers: Int32s
) -> None:
    """lasers: (2, n) first and last node of each laser so far."""
    node, ox, oy, oz = 0, around.origin[0], around.origin[1], around.origin[2]
    while node < len(points):
        found = spherical(
            around,
            integer(points[node, 0]) - ox,
            integer(points[node, 1]) - oy,
            integer(points[node, 2]) - oz,
        )
        _find_copies(points, tree, node)
        for k in range(node, node + 1 + tree.copies[node]):
            for axis in range(3):
                positions[k, axis] = found[axis]
        laser = found[2]
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


def nearest_tree(points: Int32s) -> PredictionTree:
    """The tree of points (n, 3) without a sensor."""
    tree = empty_tree(len(points))
    _grow(points, tree, empty_search(3 * len(points)))
    return tree


@entry
def _grow(points: Int32s, tree: PredictionTree, search: Search) -> None:
    node = 0
    while node < len(points):
        _find_copies(points, tree, node)
        x, y, z = integer(points[node, 0]), integer(points[node, 1]), integer(points[node, 2])
        for k in range(nearest(search, x, y, z)):
            parent = integer(search.owners[search.nearest[k]])
            if tree.num_children[parent] < MOST_CHILDREN:
                _hang(tree, node, parent)
                break
        parent = integer(tree.parents[node])
        add_position(search, node, x, y, z)
        if parent >= 0:
            a, b, c = (
                integer(points[parent, 0]),
                integer(points[parent, 1]),
                integer(points[parent, 2]),
            )
            add_position(search, node, 2 * x - a, 2 * y - b, 2 * z - c)
            before = integer(tree.parents[parent])
            if before >= 0:
                add_position(
                    search,
                    node,
                    wrapped(x + a - points[before, 0]),
                    wrapped(y + b - points[before, 1]),
                    wrapped(z + c - points[before, 2]),
                )
        node += 1 + tree.copies[node]


@entry
def _find_copies(points: Int32s, tree: PredictionTree, node: int) -> None:
    """Count the points after a node's that coincide with it, and mark them."""
    end = node + 1
    while (
        end < len(points)
        and points[end, 0] == points[node, 0]
        and points[end, 1] == points[node, 1]
        and points[end, 2] == points[node, 2]
    ):
        tree.parents[end] = DUPLICATE
        end += 1
    tree.copies[node] = end - node - 1


@entry
def _hang(tree: PredictionTree, node: int, parent: int) -> None:
    """Make a node the next child of another, which has fewer than MOST_CHILDREN."""
    tree.parents[node] = parent
    tree.children[parent, tree.num_children[parent]] = node
    tree.num_children[parent] += 1

"""K-d trees of points, and search in them for the points nearest to a place.

Trees are built and searched in the order of the library nanoflann, so that the choice among equally
near points is TMC13's. Coordinates are integers or floating-point numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.compiled import entry, integer, row
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints

Numbers = NDArray[Any]
Int32s = NDArray[np.int32]
Place = tuple[Any, Any, Any]

_LEAF = 10
_DEEPEST = 1024
"""Maximum depth of a tree. Each split halves the points or their bounding box."""


class KdTrees(NamedTuple):
    """K-d trees of points (n, 3) in common arrays, where each tree has successive `rows`."""

    points: Numbers
    # Indices of points; those of a node are successive.
    rows: Int32s
    # values, stack: working memory; `values` is as long as `rows`.
    values: Numbers
    # (m, 3) for an inner node, axis and first child, which the second child follows; for a leaf,
    # -1, start and end in `rows`.
    nodes: Int32s
    # (m, 2) largest coordinate in the first child, smallest in the second child.
    gaps: Numbers
    stack: Numbers
    # nearest, distances: (k,) result: indices of the nearest points, and their squared distances.
    nearest: Ints
    distances: Numbers


def empty_trees(points: Numbers, rows: int, nodes: int, neighbours: int) -> KdTrees:
    wide = np.result_type(points, np.int64)
    return KdTrees(
        points,
        np.empty(rows, dtype=np.int32),
        np.empty(rows, dtype=points.dtype),
        np.empty((nodes, 3), dtype=np.int32),
        np.empty((nodes, 2), dtype=points.dtype),
        np.empty((_DEEPEST, 9), dtype=wide),
        np.zeros(neighbours, dtype=np.int64),
        np.zeros(neighbours, dtype=wide),
    )


@entry
def build(trees: KdTrees, root: int, first: int, end: int, box: Numbers, share: float) -> None:
    """Build the tree of the points in the rows `first` to `end` - 1.

    Parameters
    ----------
    trees
        The trees, whose arrays are changed.
    root
        Index of the tree's first node.
    first, end
        The tree's rows.
    box
        Result (6,): the least and largest coordinates of the points.
    share
        Sides of a node's box may be split if they are at least this share of the longest side.
    """
    nodes, gaps, stack, used, depth = trees.nodes, trees.gaps, trees.stack, root + 1, 1
    for axis in range(3):
        box[axis], box[3 + axis] = _range(trees, first, end, axis)
        stack[0, 3 + axis], stack[0, 6 + axis] = box[axis], box[3 + axis]
    stack[0, 0], stack[0, 1], stack[0, 2] = root, first, end
    while depth:
        depth -= 1
        node, first, end = row(stack, depth)
        if end - first <= _LEAF or depth + 2 > len(stack):
            nodes[node, 0], nodes[node, 1], nodes[node, 2] = -1, first, end
            continue
        axis, middle = _split(trees, first, end, stack[depth], share)
        nodes[node, 0], nodes[node, 1] = axis, used
        gaps[node, 0] = _extremes(trees.values, first, middle)[1]
        gaps[node, 1] = _extremes(trees.values, middle, end)[0]
        cut = stack[depth, 0]
        for side in range(3, 9):
            stack[depth + 1, side] = stack[depth, side]
        stack[depth, 0], stack[depth, 1], stack[depth, 2] = used, first, middle
        stack[depth + 1, 0], stack[depth + 1, 1], stack[depth + 1, 2] = used + 1, middle, end
        stack[depth, 6 + axis] = stack[depth + 1, 3 + axis] = cut
        used += 2
        depth += 2


@inlined
def _extremes(values: Numbers, first: int, end: int) -> tuple[Any, Any]:
    low = high = values[first]
    for k in range(first + 1, end):
        low, high = min(low, values[k]), max(high, values[k])
    return low, high


@inlined
def _range(trees: KdTrees, first: int, end: int, axis: int) -> tuple[Any, Any]:
    """Write the rows' coordinates along an axis to `values`; return smallest and largest."""
    for k in range(first, end):
        trees.values[k] = trees.points[trees.rows[k], axis]
    return _extremes(trees.values, first, end)


@inlined
def _split(trees: KdTrees, first: int, end: int, frame: Numbers, share: float) -> tuple[int, int]:
    """Partition rows near the middle of the longest side of their box."""
    # Returns the axis and the first row of the upper half, and writes the cut to `frame`.
    longest = max(frame[6] - frame[3], frame[7] - frame[4], frame[8] - frame[5])
    low = high = frame[3]
    axis = taken = integer(-1)
    for k in range(3):
        if frame[6 + k] - frame[3 + k] >= share * longest:
            a, b = _range(trees, first, end, k)
            taken = integer(k)
            if axis < 0 or b - a > high - low:
                axis, low, high = taken, a, b
    if taken != axis:
        _range(trees, first, end, axis)
    frame[0] = (frame[3 + axis] + frame[6 + axis]) / 2  # integers are rounded towards zero
    cut = frame[0] = min(max(frame[0], low), high)
    below = _parted(trees, first, first, end, cut, False)
    up_to = _parted(trees, below, first, end, cut, True)
    return axis, min(max(first + (end - first) // 2, below), up_to)


@inlined
def _parted(trees: KdTrees, left: int, first: int, end: int, cut: Any, equal: bool) -> int:
    rows, values, right = trees.rows, trees.values, end - 1
    while True:
        while left <= right and (values[left] < cut or (equal and values[left] == cut)):
            left += 1
        while (
            right != first
            and left <= right
            and not (values[right] < cut or (equal and values[right] == cut))
        ):
            right -= 1
        if left > right or right == first:
            return left
        rows[left], rows[right] = rows[right], rows[left]
        values[left], values[right] = values[right], values[left]
        left += 1
        right -= 1


@inlined
def search(trees: KdTrees, root: int, box: Numbers, at: Place, held: int) -> int:
    """Find the points of a tree that are nearer to a place than those found before.

    Parameters
    ----------
    trees
        The trees. The fields `nearest` and `distances` receive the result. Before the first tree is
        searched, the last of `distances` must be larger than any distance.
    root, box
        The tree's first node and bounding box.
    at
        The place.
    held
        Number of nearest points found so far. Later entries of `nearest` are left from earlier
        searches.

    Returns
    -------
    int
        Number of nearest points found so far, including those of this tree.
    """
    stack, nodes, distances = trees.stack, trees.nodes, trees.distances
    last = len(distances) - 1
    stack[0, 0], stack[0, 1] = root, 0
    for axis in range(3):
        off = max(box[axis] - at[axis], at[axis] - box[3 + axis], 0)
        stack[0, 2 + axis] = off * off
        stack[0, 1] += off * off
    depth = 1
    while depth:
        depth -= 1
        node, least = integer(stack[depth, 0]), stack[depth, 1]
        if least > distances[last]:
            continue
        a, b, c = stack[depth, 2], stack[depth, 3], stack[depth, 4]
        while nodes[node, 0] >= 0:
            axis, nearer = integer(nodes[node, 0]), integer(nodes[node, 1])
            low, high, value = trees.gaps[node, 0], trees.gaps[node, 1], at[axis]
            farther, border = nearer + 1, high
            if (value - low) + (value - high) >= 0:
                nearer, farther, border = farther, nearer, low
            off = (value - border) * (value - border)
            beyond = least + off - (a if axis == 0 else b if axis == 1 else c)
            if beyond <= distances[last]:
                stack[depth, 0], stack[depth, 1] = farther, beyond
                stack[depth, 2], stack[depth, 3], stack[depth, 4] = a, b, c
                stack[depth, 2 + axis] = off
                depth += 1
            node = nearer
        held = search_rows(trees, integer(nodes[node, 1]), integer(nodes[node, 2]), at, held)
    return held


@inlined
def search_rows(trees: KdTrees, first: int, end: int, at: Place, held: int) -> int:
    nearest, distances, last = trees.nearest, trees.distances, len(trees.distances) - 1
    for k in range(first, end):
        i = integer(trees.rows[k])
        x, y = at[0] - trees.points[i, 0], at[1] - trees.points[i, 1]
        z = at[2] - trees.points[i, 2]
        distance = x * x + y * y + z * z
        if distance < distances[last]:
            place = min(held, last)
            while place > 0 and distances[place - 1] > distance:
                distances[place], nearest[place] = distances[place - 1], nearest[place - 1]
                place -= 1
            distances[place], nearest[place] = distance, i
            held = min(held + 1, last + 1)
    return held

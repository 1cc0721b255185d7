"""Binary tree of points for searches of nearest neighbours.

Points are visited in nanoflann's order, so that equally near points are chosen as in TMC13.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import inlined
from puckbench.gpcc.compiled import entry, integer, kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_LEAF = 10
_NEARLY_ONE = 1 - 0.00001
_DEEPEST = 256
"""Maximum depth; each split halves the points or their bounding box."""


class NearestTree(NamedTuple):
    """A tree of points (n, 3).

    rows: (n,) indices of the points; a node's points are adjacent.
    nodes: (m, 4) start and end of the node's points in `rows`; index of the second child, or 0 for
        a leaf; split axis. The first child follows its node.
    gaps: (m, 2) largest coordinate in the first child, smallest in the second child.
    box: (6,) bounding box of all points.
    """

    points: Floats
    rows: Ints
    nodes: Ints
    gaps: Floats
    box: Floats


class Stack(NamedTuple):
    """Working memory of a search: nodes on the path from the root, and their distances."""

    nodes: Ints
    distances: Floats
    along: Floats


def nearest_tree(points: Floats) -> NearestTree:
    count = max(2 * len(points), 1)
    tree = NearestTree(
        points,
        np.arange(len(points)),
        np.zeros((count, 4), dtype=np.int64),
        np.zeros((count, 2)),
        np.concatenate([points.min(axis=0), points.max(axis=0)]),
    )
    _build(tree, np.empty((_DEEPEST, 3), dtype=np.int64), np.empty((_DEEPEST, 6)))
    return tree


def search_stack() -> Stack:
    return Stack(
        np.empty((_DEEPEST + 2, 4), dtype=np.int64), np.empty((_DEEPEST + 2, 3)), np.empty(3)
    )


@entry
def _build(tree: NearestTree, pending: Ints, boxes: Floats) -> None:
    height, count = 1, 0
    pending[0, 0], pending[0, 1], pending[0, 2] = 0, len(tree.rows), -1
    for side in range(6):
        boxes[0, side] = tree.box[side]
    while height:
        height -= 1
        first, last, parent = pending[height, 0], pending[height, 1], pending[height, 2]
        node = count
        count += 1
        if parent >= 0:
            tree.nodes[parent, 2] = node
        tree.nodes[node, 0], tree.nodes[node, 1] = first, last
        if last - first <= _LEAF or height + 2 > len(pending):
            continue
        axis = _split_axis(tree, first, last, boxes[height])
        low, high = _range(tree, first, last, axis)
        cut = min(max((boxes[height, axis] + boxes[height, 3 + axis]) / 2, low), high)
        middle = _partition(tree, first, last, axis, cut)
        tree.nodes[node, 3] = axis
        tree.gaps[node, 0] = _range(tree, first, middle, axis)[1]
        tree.gaps[node, 1] = _range(tree, middle, last, axis)[0]
        for side in range(6):
            boxes[height + 1, side] = boxes[height, side]
        boxes[height, axis] = cut
        boxes[height + 1, 3 + axis] = cut
        pending[height, 0], pending[height, 1], pending[height, 2] = middle, last, node
        pending[height + 1, 0], pending[height + 1, 1] = first, middle
        pending[height + 1, 2] = -1
        height += 2


@kernel
def _split_axis(tree: NearestTree, first: int, last: int, box: Floats) -> int:
    longest = max(box[3] - box[0], box[4] - box[1], box[5] - box[2])
    best, widest = integer(0), -1.0
    for axis in range(3):
        if box[3 + axis] - box[axis] >= _NEARLY_ONE * longest:
            low, high = _range(tree, first, last, axis)
            if high - low > widest:
                best, widest = axis, high - low
    return best


@kernel
def _range(tree: NearestTree, first: int, last: int, axis: int) -> tuple[float, float]:
    low = high = tree.points[tree.rows[first], axis]
    for i in range(first + 1, last):
        value = tree.points[tree.rows[i], axis]
        low, high = min(low, value), max(high, value)
    return low, high


@kernel
def _partition(tree: NearestTree, first: int, last: int, axis: int, cut: float) -> int:
    """Partition points at the plane `cut`; return where the second child starts."""
    below = _move_forward(tree, first, first, last - 1, axis, cut, False)
    not_above = _move_forward(tree, first, below, last - 1, axis, cut, True)
    middle = first + (last - first) // 2
    return min(max(middle, below), not_above)


@kernel
def _move_forward(
    tree: NearestTree, first: int, left: int, right: int, axis: int, cut: float, equal: bool
) -> int:
    points, rows = tree.points, tree.rows
    while True:
        while left <= right and _is_before(points[rows[left], axis], cut, equal):
            left += 1
        while (
            right > first
            and left <= right
            and not _is_before(points[rows[right], axis], cut, equal)
        ):
            right -= 1
        if left > right or right <= first:
            return left
        rows[left], rows[right] = rows[right], rows[left]
        left += 1
        right -= 1


@inlined
def _is_before(value: float, cut: float, equal: bool) -> bool:
    before: bool = value <= cut if equal else value < cut
    return before


@kernel
def search(
    tree: NearestTree, x: float, y: float, z: float, stack: Stack, rows: Ints, squares: Floats
) -> int:
    """Write the nearest points and their squared distances, nearest first; return their number.

    Of the remaining entries, only the last changes.
    """
    capacity, count = len(rows), 0
    squares[capacity - 1] = np.inf
    place = (x, y, z)
    total = 0.0
    for axis in range(3):
        outside = max(tree.box[axis] - place[axis], place[axis] - tree.box[3 + axis], 0.0)
        stack.along[axis] = outside * outside
        total += outside * outside
    depth = 1
    stack.nodes[0, 0], stack.nodes[0, 1], stack.distances[0, 0] = 0, 0, total
    while depth:
        top = depth - 1
        node = stack.nodes[top, 0]
        first, last, second = tree.nodes[node, 0], tree.nodes[node, 1], tree.nodes[node, 2]
        axis = tree.nodes[node, 3]
        if second == 0:
            worst = squares[capacity - 1]
            for i in range(first, last):
                row = tree.rows[i]
                a, b, c = x - tree.points[row, 0], y - tree.points[row, 1], z - tree.points[row, 2]
                square = a * a + b * b + c * c
                if square < worst:
                    count = _insert(rows, squares, count, row, square)
            depth -= 1
        elif stack.nodes[top, 1] == 0:
            value = place[axis]
            low, high = tree.gaps[node, 0], tree.gaps[node, 1]
            is_first = (value - low) + (value - high) < 0
            cut = value - (high if is_first else low)
            stack.nodes[top, 1] = 1
            stack.nodes[top, 2] = second if is_first else node + 1
            stack.distances[top, 1] = cut * cut
            stack.nodes[depth, 0] = node + 1 if is_first else second
            stack.nodes[depth, 1], stack.distances[depth, 0] = 0, stack.distances[top, 0]
            depth += 1
        elif stack.nodes[top, 1] == 1:
            stack.nodes[top, 1] = 2
            stack.distances[top, 2] = stack.along[axis]
            least = stack.distances[top, 0] + stack.distances[top, 1] - stack.along[axis]
            stack.along[axis] = stack.distances[top, 1]
            if least <= squares[capacity - 1]:
                stack.nodes[depth, 0] = stack.nodes[top, 2]
                stack.nodes[depth, 1], stack.distances[depth, 0] = 0, least
                depth += 1
        else:
            stack.along[axis] = stack.distances[top, 2]
            depth -= 1
    return count


@inlined
def _insert(rows: Ints, squares: Floats, count: int, row: int, square: float) -> int:
    capacity = len(rows)
    i = count
    while i > 0 and squares[i - 1] > square:
        if i < capacity:
            squares[i], rows[i] = squares[i - 1], rows[i - 1]
        i -= 1
    if i < capacity:
        squares[i], rows[i] = square, row
    return min(count + 1, capacity)

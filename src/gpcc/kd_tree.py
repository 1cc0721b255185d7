"""K-d trees of points, and search in them for the points nearest to a place.

Trees are built and searched in the order of the library nanoflann, so that the choice among equally
near points is TMC13's. Coordinates are integers or floating-point numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.compiled import entry, integer, row, unsigned
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints
from pointkit.threads import allowed_threads, in_threads

Numbers = NDArray[Any]
Int32s = NDArray[np.int32]
Place = tuple[Any, Any, Any]

_LEAF = 10
_BLOCK = 32
"""Number of rows in a mask of rows to exchange."""
_DEEPEST = 1024
"""Maximum depth of a tree. Each split halves the points or their bounding box."""


class KdTrees(NamedTuple):
    """K-d trees of points in common arrays, where each tree has successive rows."""

    # (3, n) coordinates of the point in each row; those of a node are successive.
    places: Numbers
    # (n,) index of the point in each row.
    rows: Int32s
    # (2n, 3) for an inner node, axis and first child, which the second child follows; for a leaf,
    # -1, start and end in `rows`. A tree that begins at row r has its root at 2r.
    nodes: Int32s
    # (2n, 2) largest coordinate in the first child, smallest in the second child.
    gaps: Numbers
    stack: Numbers
    # nearest, distances: (k,) result: indices of the nearest points, and their squared distances.
    nearest: Ints
    distances: Numbers


def empty_trees(numbers: type, rows: int, neighbours: int) -> KdTrees:
    """Return trees without points, whose coordinates are `numbers` (a type of NumPy)."""
    wide = np.result_type(numbers, np.int64)
    return KdTrees(
        np.empty((3, rows), dtype=numbers),
        np.empty(rows, dtype=np.int32),
        np.empty((2 * rows, 3), dtype=np.int32),
        np.empty((2 * rows, 2), dtype=numbers),
        np.empty((_DEEPEST, 9), dtype=wide),
        np.zeros(neighbours, dtype=np.int64),
        np.zeros(neighbours, dtype=wide),
    )


@entry
def build(trees: KdTrees, first: int, end: int, box: Numbers, share: float) -> None:
    """Build the tree of the points in the rows `first` to `end` - 1.

    Parameters
    ----------
    trees
        The trees, whose arrays are changed.
    first, end
        The tree's rows.
    box
        Result (6,): the least and largest coordinates of the points.
    share
        Sides of a node's box may be split if they are at least this share of the longest side.
    """
    _enter(trees, first, end, box)
    _build_below(trees, share)


def build_in_threads(trees: KdTrees, first: int, end: int, box: Numbers, share: float) -> None:
    """Build the tree of the points in the rows `first` to `end` - 1, its parts in several threads.

    The tree is the one that `build` makes, which takes the same arguments. Only for many points
    does this take less time.
    """
    _enter(trees, first, end, box)
    parts = [trees]
    while len(parts) < 2 * allowed_threads():
        largest = max(parts, key=lambda part: float(part.stack[0, 2] - part.stack[0, 1]))
        other = trees._replace(stack=np.empty_like(trees.stack))
        _halve(largest, other.stack[0], share)
        parts.append(other)
    in_threads(lambda part: _build_below(part, share), parts)


@entry
def _enter(trees: KdTrees, first: int, end: int, box: Numbers) -> None:
    """Write the root's frame to the stack: node, rows, and sides of the box."""
    stack = trees.stack
    for axis in range(3):
        box[axis], box[3 + axis] = _range(trees.places[axis], first, end)
        stack[0, 3 + axis], stack[0, 6 + axis] = box[axis], box[3 + axis]
    stack[0, 0], stack[0, 1], stack[0, 2] = 2 * first, first, end


@entry
def _halve(trees: KdTrees, other: Numbers, share: float) -> None:
    """Split the stack's first node; its first child takes its place, the second is `other`."""
    # No other node of the tree has the numbers of these children.
    _divide(trees, trees.stack[0], other, 0, share)


@entry
def _build_below(trees: KdTrees, share: float) -> None:
    """Build the tree of the stack's first node."""
    nodes, stack, depth = trees.nodes, trees.stack, 1
    used = 2 * integer(stack[0, 1]) + 2
    while depth:
        depth -= 1
        node, first, end = row(stack, depth)
        if end - first <= _LEAF or depth + 2 > len(stack):
            nodes[node, 0], nodes[node, 1], nodes[node, 2] = -1, first, end
            continue
        _divide(trees, stack[depth], stack[depth + 1], used, share)
        used += 2
        depth += 2


@inlined
def _divide(trees: KdTrees, frame: Numbers, other: Numbers, child: int, share: float) -> None:
    """Split a node. Its frame becomes that of the first child, and `other` that of the second."""
    # child: number of the first child, or 0 for twice the first row of the second child.
    node, first, end = integer(frame[0]), integer(frame[1]), integer(frame[2])
    axis, middle = _split(trees, node, first, end, frame, share)
    child = child or 2 * middle
    trees.nodes[node, 0], trees.nodes[node, 1] = axis, child
    cut = frame[0]
    for side in range(3, 9):
        other[side] = frame[side]
    frame[0], frame[1], frame[2] = child, first, middle
    other[0], other[1], other[2] = child + 1, middle, end
    frame[6 + axis] = other[3 + axis] = cut


@inlined
def _range(values: Numbers, first: int, end: int) -> tuple[Any, Any]:
    low = high = values[first]
    for k in range(unsigned(first + 1), unsigned(end)):
        low, high = min(low, values[k]), max(high, values[k])
    return low, high


@inlined
def _split(
    trees: KdTrees, node: int, first: int, end: int, frame: Numbers, share: float
) -> tuple[int, int]:
    """Partition rows near the middle of the longest side of their box, and write the gap."""
    # Returns the axis and the first row of the upper half, and writes the cut to `frame`.
    longest = max(frame[6] - frame[3], frame[7] - frame[4], frame[8] - frame[5])
    low = high = frame[3]
    axis = integer(-1)
    for k in range(3):
        if frame[6 + k] - frame[3 + k] >= share * longest:
            a, b = _range(trees.places[k], first, end)
            if axis < 0 or b - a > high - low:
                axis, low, high = integer(k), a, b
    frame[0] = (frame[3 + axis] + frame[6 + axis]) / 2  # integers are rounded towards zero
    frame[0] = min(max(frame[0], low), high)
    gap, values = trees.gaps[node], trees.places[axis]
    gap[0] = frame[0]
    cut = gap[0]  # as a coordinate, so that a vector holds more of them
    below, equal = integer(0), integer(0)
    for k in range(unsigned(first), unsigned(end)):
        below += integer(values[k] < cut)
        equal += integer(values[k] == cut)
    below += first
    _part(trees, axis, (first, below, end), cut, False)
    if equal:
        _part(trees, axis, (below, below + equal, end), cut, True)
    middle = min(max(first + (end - first) // 2, below), below + equal)
    gap[0] = _range(values, first, middle)[1]
    gap[1] = _range(values, middle, end)[0]
    return axis, middle


@inlined
def _part(trees: KdTrees, axis: int, parts: Place, cut: Any, equal: bool) -> None:
    """Exchange rows until the coordinates of the first ones are below a cut, as nanoflann does.

    With `equal`, coordinates equal to the cut come first, too. Which rows are exchanged decides the
    order of rows, and so the bytes of a stream.
    """
    # Its two scans meet at the end of these rows; each exchange is of rows in the wrong part. They
    # are found as masks, without branches, which a processor could not predict.
    left, middle, right = parts
    places, rows, values = trees.places, trees.rows, trees.places[axis]
    start, high, last, low = integer(0), integer(0), integer(0), integer(0)
    while True:
        while high == 0:
            if left >= middle:
                return
            start, left = left, min(left + _BLOCK, middle)
            for k in range(unsigned(start), unsigned(left)):
                wrong = values[k] > cut if equal else values[k] >= cut
                high |= integer(wrong) << (integer(k) - start)
        while low == 0:
            last, right = right - 1, max(right - _BLOCK, middle)
            for k in range(unsigned(right), unsigned(last + 1)):
                wrong = values[k] <= cut if equal else values[k] < cut
                low |= integer(wrong) << (last - integer(k))
        while high and low:
            i, j = start + _first_bit(high), last - _first_bit(low)
            high, low = high & high - 1, low & low - 1
            rows[i], rows[j] = rows[j], rows[i]
            for side in range(3):
                places[side, i], places[side, j] = places[side, j], places[side, i]


@inlined
def _first_bit(mask: int) -> int:
    bit: int = 63 - leading_zeros(mask & -mask)
    return bit


@inlined
def search(trees: KdTrees, first: int, box: Numbers, at: Place, held: int) -> int:
    """Find the points of a tree that are nearer to a place than those found before.

    Parameters
    ----------
    trees
        The trees. The fields `nearest` and `distances` receive the result. Before the first tree is
        searched, the last of `distances` must be larger than any distance.
    first, box
        The tree's first row and bounding box.
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
    stack[0, 0], stack[0, 1] = 2 * first, 0
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
    places = trees.places
    for k in range(first, end):
        x, y, z = at[0] - places[0, k], at[1] - places[1, k], at[2] - places[2, k]
        distance = x * x + y * y + z * z
        if distance < distances[last]:
            place = min(held, last)
            while place > 0 and distances[place - 1] > distance:
                distances[place], nearest[place] = distances[place - 1], nearest[place - 1]
                place -= 1
            distances[place], nearest[place] = distance, integer(trees.rows[k])
            held = min(held + 1, last + 1)
    return held

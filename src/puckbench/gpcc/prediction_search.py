"""Search for nearest positions in a growing set, with k-d trees whose sizes are powers of two.

A new position and all trees below the first unused size are merged to one tree (Bentley's
logarithmic method). Of equally near positions, the first visited is kept, as in TMC13.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import inlined
from puckbench.geometry.morton import Ints
from puckbench.gpcc.compiled import integer, kernel

Int32s = NDArray[np.int32]

NEIGHBOURS = 3
_LEAF = 10
_LEAF_LOG2 = 3
"""Trees of up to 2^3 positions are single leaves; those of 2^4 are split."""
_DEEPEST = 1024
_FAR = (1 << 62) - 1


class Search(NamedTuple):
    """The k-d trees; that of 2^k positions starts at `rows[2^k]` and `nodes[2^(k + 1)]`.

    owners: (n,) node that predicts each position.
    rows: indices of positions.
    nodes: (2 n, 5) axis, maximum of the lower half, minimum of the upper half, two children; or for
        a leaf -1, and its start and end in `rows`.
    nearest, distances: (3,) result: indices of positions, and squared distances.
    """

    positions: Int32s
    owners: Int32s
    rows: Int32s
    values: Int32s
    nodes: Int32s
    boxes: Ints
    counters: Ints
    stack: Ints
    nearest: Ints
    distances: Ints


def empty_search(most: int) -> Search:
    trees = max(most, 1).bit_length()
    return Search(
        np.empty((most, 3), dtype=np.int32),
        np.empty(most, dtype=np.int32),
        np.empty(2 << trees, dtype=np.int32),
        np.empty(2 << trees, dtype=np.int32),
        np.empty((4 << trees, 5), dtype=np.int32),
        np.empty((trees, 2, 3), dtype=np.int64),
        np.zeros(1, dtype=np.int64),
        np.empty((_DEEPEST, 9), dtype=np.int64),
        np.empty(NEIGHBOURS, dtype=np.int64),
        np.empty(NEIGHBOURS, dtype=np.int64),
    )


@kernel
def add_position(search: Search, owner: int, x: int, y: int, z: int) -> None:
    row = search.counters[0]
    search.positions[row, 0] = x
    search.positions[row, 1] = y
    search.positions[row, 2] = z
    search.owners[row] = owner
    tree = 0
    while row >> tree & 1:
        tree += 1
    place = 1 << tree
    for smaller in range(tree):
        start = 1 << smaller
        for k in range(start, 2 * start):
            search.rows[place] = search.rows[k]
            place += 1
    search.rows[place] = row
    search.counters[0] += 1
    _build(search, tree)


@kernel
def _build(search: Search, tree: int) -> None:
    if tree <= _LEAF_LOG2:
        return
    start, size, box = 1 << tree, 1 << tree, search.boxes[tree]
    _find_box(search, start, start + size, box)
    root = 2 * start
    used, depth = root + 1, 1
    _push(search.stack, 0, root, start, start + size)
    for axis in range(3):
        search.stack[0, 3 + axis] = box[0, axis]
        search.stack[0, 6 + axis] = box[1, axis]
    while depth:
        depth -= 1
        node, first, end = search.stack[depth, 0], search.stack[depth, 1], search.stack[depth, 2]
        if end - first <= _LEAF:
            _make_leaf(search, node, first, end)
            continue
        axis, cut, middle = _split(search, first, end, search.stack[depth])
        search.nodes[node, 0] = axis
        search.nodes[node, 1] = _greatest(search.values, first, middle)
        search.nodes[node, 2] = _least(search.values, middle, end)
        search.nodes[node, 3] = used
        search.nodes[node, 4] = used + 1
        for k in range(3, 9):
            search.stack[depth + 1, k] = search.stack[depth, k]
        _push(search.stack, depth, used, first, middle)
        _push(search.stack, depth + 1, used + 1, middle, end)
        search.stack[depth, 6 + axis] = cut
        search.stack[depth + 1, 3 + axis] = cut
        used += 2
        depth += 2


@inlined
def _push(stack: Ints, depth: int, node: int, first: int, end: int) -> None:
    stack[depth, 0] = node
    stack[depth, 1] = first
    stack[depth, 2] = end


@inlined
def _make_leaf(search: Search, node: int, first: int, end: int) -> None:
    search.nodes[node, 0] = -1
    search.nodes[node, 1] = first
    search.nodes[node, 2] = end


@inlined
def _find_box(search: Search, first: int, end: int, box: Ints) -> None:
    row = search.rows[first]
    ax, ay, az = _position(search, row)
    bx, by, bz = ax, ay, az
    for k in range(first + 1, end):
        x, y, z = _position(search, search.rows[k])
        ax, ay, az = min(ax, x), min(ay, y), min(az, z)
        bx, by, bz = max(bx, x), max(by, y), max(bz, z)
    box[0, 0], box[0, 1], box[0, 2] = ax, ay, az
    box[1, 0], box[1, 1], box[1, 2] = bx, by, bz


@inlined
def _position(search: Search, row: int) -> tuple[int, int, int]:
    positions = search.positions
    return integer(positions[row, 0]), integer(positions[row, 1]), integer(positions[row, 2])


@inlined
def _greatest(values: Int32s, first: int, end: int) -> int:
    most = values[first]
    for k in range(first + 1, end):
        most = max(most, values[k])
    return integer(most)


@inlined
def _least(values: Int32s, first: int, end: int) -> int:
    least = values[first]
    for k in range(first + 1, end):
        least = min(least, values[k])
    return integer(least)


@inlined
def _take_values(search: Search, first: int, end: int, axis: int) -> None:
    for k in range(first, end):
        search.values[k] = search.positions[search.rows[k], axis]


@inlined
def _split(search: Search, first: int, end: int, frame: Ints) -> tuple[int, int, int]:
    """Partition rows near the middle of a box's longest side; return axis, cut and first row of the
    upper half.
    """
    longest = max(frame[6] - frame[3], frame[7] - frame[4], frame[8] - frame[5])
    axis, spread, low, high, taken = 0, -1, 0, 0, 0
    for k in range(3):
        if frame[6 + k] - frame[3 + k] >= longest:
            _take_values(search, first, end, k)
            taken = k
            a, b = _least(search.values, first, end), _greatest(search.values, first, end)
            if b - a > spread:
                axis, spread, low, high = k, b - a, a, b
    if taken != axis:
        _take_values(search, first, end, axis)
    total = frame[3 + axis] + frame[6 + axis]
    cut = total >> 1 if total >= 0 else -((-total) >> 1)
    cut = min(max(cut, low), high)
    below = _parted(search, first, first, end, cut)
    up_to = _parted(search, below, first, end, cut + 1)
    middle = (end - first) // 2
    if below - first > middle:
        return axis, cut, below
    if up_to - first < middle:
        return axis, cut, up_to
    return axis, cut, first + middle


@inlined
def _parted(search: Search, left: int, first: int, end: int, cut: int) -> int:
    rows, values, right = search.rows, search.values, end - 1
    while True:
        while left <= right and values[left] < cut:
            left += 1
        while right != first and left <= right and values[right] >= cut:
            right -= 1
        if left > right or right == first:
            return left
        rows[left], rows[right] = rows[right], rows[left]
        values[left], values[right] = values[right], values[left]
        left += 1
        right -= 1


@kernel
def nearest(search: Search, x: int, y: int, z: int) -> int:
    """Write the positions nearest to a point, at most 3, to `search`; return their number."""
    held, count = 0, search.counters[0]
    search.distances[NEIGHBOURS - 1] = _FAR
    tree = 0
    while count >> tree:
        if count >> tree & 1 and tree <= _LEAF_LOG2:
            held = _search_leaf(search, 1 << tree, 2 << tree, held, (x, y, z))
        elif count >> tree & 1:
            held = _search_tree(search, tree, held, (x, y, z))
        tree += 1
    return held


@inlined
def _search_tree(search: Search, tree: int, held: int, at: tuple[int, int, int]) -> int:
    stack, box = search.stack, search.boxes[tree]
    stack[0, 0] = 2 << tree
    stack[0, 1] = 0
    for axis in range(3):
        off = max(box[0, axis] - at[axis], at[axis] - box[1, axis], 0)
        stack[0, 2 + axis] = off * off
        stack[0, 1] += off * off
    depth = 1
    while depth:
        depth -= 1
        node, least = stack[depth, 0], stack[depth, 1]
        if least > search.distances[NEIGHBOURS - 1]:
            continue
        a, b, c = stack[depth, 2], stack[depth, 3], stack[depth, 4]
        while search.nodes[node, 0] >= 0:
            axis = integer(search.nodes[node, 0])
            low, high = integer(search.nodes[node, 1]), integer(search.nodes[node, 2])
            value = at[axis]
            nearer, farther, border = 4, 3, low
            if 2 * value - low - high < 0:
                nearer, farther, border = 3, 4, high
            off = (value - border) * (value - border)
            beyond = least + off - (a if axis == 0 else b if axis == 1 else c)
            if beyond <= search.distances[NEIGHBOURS - 1]:
                stack[depth, 0] = search.nodes[node, farther]
                stack[depth, 1] = beyond
                stack[depth, 2] = a
                stack[depth, 3] = b
                stack[depth, 4] = c
                stack[depth, 2 + axis] = off
                depth += 1
            node = integer(search.nodes[node, nearer])
        first, end = integer(search.nodes[node, 1]), integer(search.nodes[node, 2])
        held = _search_leaf(search, first, end, held, at)
    return held


@inlined
def _search_leaf(search: Search, first: int, end: int, held: int, at: tuple[int, int, int]) -> int:
    worst = search.distances[NEIGHBOURS - 1]
    for k in range(first, end):
        row = integer(search.rows[k])
        dx = at[0] - search.positions[row, 0]
        dy = at[1] - search.positions[row, 1]
        dz = at[2] - search.positions[row, 2]
        distance = dx * dx + dy * dy + dz * dz
        if distance < worst:
            _keep(search, held, row, distance)
            held = min(held + 1, NEIGHBOURS)
            worst = search.distances[NEIGHBOURS - 1]
    return held


@inlined
def _keep(search: Search, held: int, row: int, distance: int) -> None:
    place = min(held, NEIGHBOURS - 1)
    while place > 0 and search.distances[place - 1] > distance:
        search.distances[place] = search.distances[place - 1]
        search.nearest[place] = search.nearest[place - 1]
        place -= 1
    search.distances[place] = distance
    search.nearest[place] = row

"""Octree of points, whose levels may split fewer than three axes.

Levels that split one or two axes are those of a binary tree or a quadtree (QTBT).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc.arithmetic import Bytes
from gpcc.compiled import compiled, integer
from gpcc.kd_tree import Int32s
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints

Bits = tuple[int, int, int]

_AXIS_MASKS = (4, 2, 1)


def coded_axes(
    bits: Bits,
    qtbt: bool,
    max_num_qtbt_before_ot: int = 4,
    min_qtbt_size_log2: int = 0,
    late_z: tuple[int, int] | None = None,
) -> list[int]:
    """Return the axes that each level of the octree splits, from the root to the leaves.

    Parameters
    ----------
    bits
        Log2 of the root's sides along x, y and z.
    qtbt
        Whether levels may split fewer than three axes.
    max_num_qtbt_before_ot, min_qtbt_size_log2
        As in `GpccOptions`.
    late_z
        With a sensor, the options angular_max_node_min_dim_log2_to_split_z and
        angular_max_diff_to_split_z.

    Returns
    -------
    list of int
        A mask of axes for each level: 4 for x, 2 for y and 1 for z.
    """
    if not qtbt:
        return [7] * max(bits)
    longest, shortest = max(bits), min(bits)
    max_num_qtbt_before_ot = min(max_num_qtbt_before_ot, longest - shortest)
    min_qtbt_size_log2 = 0 if longest == shortest else min(min_qtbt_size_log2, shortest)
    size, levels = list(bits), []
    while max(size) > 0:
        if max_num_qtbt_before_ot > 0 or min(size) == min_qtbt_size_log2:
            split = [side == max(size) for side in size]
        elif late_z and min_qtbt_size_log2 >= 0 and size[2] <= late_z[0] and sum(late_z) > 0:
            split = _split_late_along_z(size, *late_z)
        else:
            split = [True, True, True]
        levels.append(sum(a for a, s in zip(_AXIS_MASKS, split, strict=True) if s))
        size = [side - s for side, s in zip(size, split, strict=True)]
        max_num_qtbt_before_ot = max(max_num_qtbt_before_ot - 1, 0)
        if min(size) == max(size) == min_qtbt_size_log2:
            min_qtbt_size_log2 = -1
    return levels


def _split_late_along_z(size: list[int], height: int, factor: int) -> list[bool]:
    x, y, z = size
    longest = max(x, y)
    high = min(size) <= height and z >= longest + factor
    large = longest >= height + factor and z >= longest
    return [x == longest, y == longest, high or large]


def node_sizes_log2(levels: list[int]) -> list[Bits]:
    """Return log2 of the sides of a node at each level, and (0, 0, 0) for the leaves at the end."""
    sizes = [(0, 0, 0)]
    for axes in reversed(levels):
        x, y, z = sizes[-1]
        sizes.append((x + (axes >> 2 & 1), y + (axes >> 1 & 1), z + (axes & 1)))
    return sizes[::-1]


@dataclass(frozen=True)
class TreeLevel:
    """Occupancy of each node of a level, and index of the node's first child in the next level."""

    occupancy: Bytes
    first_child: Int32s


@dataclass(frozen=True)
class Tree:
    """Octree of a slice, as levels from the root down and leaves."""

    levels: list[TreeLevel]
    # Interleaved coordinate bits of each leaf, sorted.
    keys: Ints
    # Number of points at each leaf.
    counts: Int32s
    # 1 for the first of a node's only two leaves if TMC13 puts the second first; empty unless
    # requested.
    second_first: Bytes


def build_tree(
    points: Ints, corner: Ints, levels: list[int], ordered: bool = False, merged: bool = False
) -> Tree:
    """Build the octree of integer points (n, 3), and return it.

    Parameters
    ----------
    points
        Integer coordinates (n, 3).
    corner
        Least corner (3,) of the root.
    levels
        Axes that each level splits, as `coded_axes` returns them.
    ordered
        Whether to find the order of two points that are alone in a node (`Tree.second_first`).
    merged
        Whether repeated points are ignored in this order.
    """
    keys = _keys(points, corner, _key_tables(_key_positions(levels)))
    second_first = np.empty(0, dtype=np.uint8)
    if ordered:
        keys = _first_ones(keys) if merged else keys
        second_first = _sorted_as_coded(keys, _digit_positions(levels), np.empty(0, np.int32))
    else:
        keys.sort()
    starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    counts = np.diff(starts, append=len(keys)).astype(np.int32)
    keys = keys[starts]
    if ordered:
        second_first = second_first[starts]
    reversed_levels, below = [], keys
    for axes in reversed(levels):
        children = _child_of_bits(axes)
        below, occupancy, first = _parents(below, children.size.bit_length() - 1, children)
        reversed_levels.append(TreeLevel(occupancy, first))
    return Tree(reversed_levels[::-1], keys, counts, second_first)


def leaf_starts(tree: Tree) -> list[Int32s]:
    """Return the index of each node's first leaf, as an array (m + 1,) for each level.

    The last entry of an array is the number of leaves.
    """
    starts = [np.arange(len(tree.keys) + 1, dtype=np.int32)]
    for level in reversed(tree.levels):
        starts.append(starts[-1][np.append(level.first_child, len(starts[-1]) - 1)])
    return starts[:0:-1]


def leaf_codes(tree: Tree, levels: list[int]) -> Ints:
    if all(axes == 7 for axes in levels):
        return tree.keys
    tables = np.zeros((8, 256), dtype=np.int64)
    for axis, positions in enumerate(_key_positions(levels)):
        for bit, position in enumerate(positions):
            is_set = np.arange(256) >> position % 8 & 1
            tables[position // 8] |= is_set << (3 * bit + 2 - axis)
    return _permuted(tree.keys, tables)


def _key_positions(levels: list[int]) -> tuple[list[int], list[int], list[int]]:
    positions: tuple[list[int], list[int], list[int]] = ([], [], [])
    position = 0
    for axes in reversed(levels):
        for axis in (2, 1, 0):
            if axes & _AXIS_MASKS[axis]:
                positions[axis].append(position)
                position += 1
    return positions


def _key_tables(positions: tuple[list[int], list[int], list[int]]) -> Ints:
    tables = np.zeros((3, 3, 256), dtype=np.int64)
    for axis, of_axis in enumerate(positions):
        for bit, position in enumerate(of_axis):
            tables[axis, bit // 8] |= (np.arange(256) >> bit % 8 & 1) << position
    return tables


def _child_of_bits(axes: int) -> Ints:
    children = [child for child in range(8) if child & ~axes == 0]
    return np.array(children, dtype=np.int64)


@compiled
def _keys(points: Ints, corner: Ints, tables: Ints) -> Ints:
    keys = np.empty(len(points), dtype=np.int64)
    for i in range(len(points)):
        key = 0
        for axis in range(3):
            value = points[i, axis] - corner[axis]
            for byte in range(3):
                key |= tables[axis, byte, value >> 8 * byte & 0xFF]
        keys[i] = key
    return keys


def _first_ones(keys: Ints) -> Ints:
    ordered = np.sort(keys)
    if (ordered[1:] != ordered[:-1]).all():
        return keys
    _, first = np.unique(keys, return_index=True)
    first.sort()
    unique: Ints = keys[first]
    return unique


def _digit_positions(levels: list[int]) -> Ints:
    widths = [axes.bit_count() for axes in reversed(levels)]
    return np.cumsum([0, *widths])[::-1].astype(np.int64)


def sorted_rows(points: Ints, corner: Ints, levels: list[int], tree: Tree) -> NDArray[Any]:
    """Return the indices that sort points (n, 3) in octree order; equal points sort as in TMC13."""
    keys = _keys(points, corner, _key_tables(_key_positions(levels)))
    if len(tree.keys) == len(keys):
        return np.argsort(keys)
    rows = np.arange(len(keys), dtype=np.int32)
    _sorted_as_coded(keys, _digit_positions(levels), rows)
    return rows


@compiled
def _sorted_as_coded(keys: Ints, positions: Ints, rows: Int32s) -> Bytes:
    """Sort keys in place, level by level, with the swaps of TMC13's counting sort."""
    # Returns `second_first` (see `Tree`) for each key. The swaps also apply to `rows`, if not
    # empty.
    # The swaps change the order of points within a child.
    behind = np.zeros(len(keys), dtype=np.uint8)
    stack = np.empty((8 * len(positions) + 8, 3), dtype=np.int64)
    place = np.empty(8, dtype=np.int64)
    end = np.empty(8, dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, len(keys), 0
    height = 1
    while height:
        height -= 1
        first, last, level = stack[height, 0], stack[height, 1], stack[height, 2]
        if last - first == 2 and keys[first] > keys[first + 1]:
            _swap(keys, rows, first, first + 1)
            behind[first] = 1
        if last - first <= 2 or level + 1 == len(positions):
            continue
        shift = positions[level + 1]
        mask = (1 << (positions[level] - shift)) - 1
        end[:] = 0
        for i in range(first, last):
            end[keys[i] >> shift & mask] += 1
        total = first
        for digit in range(mask + 1):
            place[digit] = total
            total += end[digit]
            end[digit] = total
        start = first
        for digit in range(mask + 1):
            while place[digit] != end[digit]:
                i = place[digit]
                target = keys[i] >> shift & mask
                other = place[target]
                _swap(keys, rows, i, other)
                place[target] += 1
            if end[digit] > start + 1:
                stack[height, 0], stack[height, 1] = start, end[digit]
                stack[height, 2] = level + 1
                height += 1
            start = end[digit]
    return behind


@inlined
def _swap(keys: Ints, rows: Int32s, i: int, k: int) -> None:
    keys[i], keys[k] = keys[k], keys[i]
    if len(rows):
        rows[i], rows[k] = rows[k], rows[i]


@compiled
def _permuted(keys: Ints, tables: Ints) -> Ints:
    codes = np.zeros(len(keys), dtype=np.int64)
    for i in range(len(keys)):
        for byte in range(8):
            codes[i] |= tables[byte, keys[i] >> 8 * byte & 0xFF]
    return codes


@compiled
def _parents(keys: Ints, width: int, child_of_bits: Ints) -> tuple[Ints, Bytes, Int32s]:
    count = 1
    for i in range(1, len(keys)):
        count += integer((keys[i] ^ keys[i - 1]) >> width != 0)
    parents = np.empty(count, dtype=np.int64)
    occupancy = np.zeros(count, dtype=np.uint8)
    first = np.empty(count, dtype=np.int32)
    k = -1
    for i in range(len(keys)):
        key = keys[i] >> width
        if k < 0 or parents[k] != key:
            k += 1
            parents[k] = key
            first[k] = i
        occupancy[k] |= np.uint8(1 << child_of_bits[keys[i] & ((1 << width) - 1)])
    return parents, occupancy, first

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats, bounds
from puckbench.primitives.octree_arrays import Ints

_BITS = 21
"""Bits per coordinate in a key."""


class CellGroups(NamedTuple):
    cells: Ints  # (m, 3) occupied cells, sorted by x, then y, then z
    counts: Floats  # (m,) numbers of points
    means: Floats  # (m, 3) means of the points, in cells relative to the origin
    cell_of: Ints  # (n,) index of each point's cell

    def sorted_rows(self) -> tuple[Ints, Ints]:
        """Return the point indices (n,) sorted by cell, and each cell's start (m,) among them."""
        counts = self.counts.astype(np.int64)
        starts = np.cumsum(counts) - counts
        return _counting_sort(self.cell_of, starts), starts


def group_by_cell(
    points: Floats, side: float, origin: Floats | None = None, *, centred: bool = False
) -> CellGroups:
    """Group points (n, 3), n > 0, by cells of a grid.

    The points must span fewer than 2^21 cells per axis. `origin` (3,), by default zeros, is the
    centre (if `centred`) or the lowest corner of cell (0, 0, 0).
    """
    origin = np.zeros(3) if origin is None else origin
    low, _ = bounds(points)
    first = _cell_of_positions((low - origin) / side, centred)
    keys, sums, cell_of = _group(points, origin, side, centred, first)
    order = np.argsort(keys)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    keys, sums = keys[order], sums[order]
    mask = (1 << _BITS) - 1
    cells = np.stack([keys >> 2 * _BITS, keys >> _BITS & mask, keys & mask], axis=1) + first
    return CellGroups(cells, sums[:, 3], sums[:, :3] / sums[:, 3:], rank[cell_of])


def cell_keys(cells: Ints) -> Ints:
    """Pack cells (n, 3) in [0, 2^21) into integers (n,) that sort by x, then y, then z."""
    return (cells[:, 0] << 2 * _BITS) | (cells[:, 1] << _BITS) | cells[:, 2]


def _cell_of_positions(positions: Floats, centred: bool) -> Ints:
    return np.asarray((np.rint(positions) if centred else np.floor(positions)).astype(np.int64))


@compiled
def _group(
    points: Floats, origin: Floats, side: float, centred: bool, first: Ints
) -> tuple[Ints, Floats, Ints]:
    """Return cell keys (m,), cell sums of x, y, z, 1 (m, 4), and each point's cell index (n,)."""
    cell_of = np.empty(len(points), np.int64)
    keys, sums = np.empty(1024, np.int64), np.zeros((1024, 4))
    slots = np.full(4096, -1)
    count, previous_key, row = 0, -1, -1
    for i in range(len(points)):
        x = (points[i, 0] - origin[0]) / side
        y = (points[i, 1] - origin[1]) / side
        z = (points[i, 2] - origin[2]) / side
        if centred:
            a, b, c = int(np.rint(x)), int(np.rint(y)), int(np.rint(z))
        else:
            a, b, c = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        key = ((a - first[0]) << 2 * _BITS) | ((b - first[1]) << _BITS) | (c - first[2])
        if key != previous_key:
            slot = _slot(slots, keys, key)
            if slots[slot] < 0:
                if count == len(keys):
                    keys = np.concatenate((keys, np.empty_like(keys)))
                    sums = np.concatenate((sums, np.zeros_like(sums)))
                    slots = np.full(2 * len(slots), -1)
                    for k in range(count):
                        slots[_slot(slots, keys, keys[k])] = k
                    slot = _slot(slots, keys, key)
                slots[slot] = count
                keys[count] = key
                count += 1
            previous_key, row = key, slots[slot]
        sums[row, 0] += x
        sums[row, 1] += y
        sums[row, 2] += z
        sums[row, 3] += 1.0
        cell_of[i] = row
    return keys[:count], sums[:count], cell_of


@compiled
def _counting_sort(cell_of: Ints, starts: Ints) -> Ints:
    order, ahead = np.empty_like(cell_of), starts.copy()
    for i in range(len(cell_of)):
        order[ahead[cell_of[i]]] = i
        ahead[cell_of[i]] += 1
    return order


@compiled
def _slot(slots: Ints, keys: Ints, key: int) -> int:
    hashed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = np.int64(hashed >> np.uint64(20)) & (len(slots) - 1)
    while slots[slot] >= 0 and keys[slots[slot]] != key:
        slot = (slot + 1) & (len(slots) - 1)
    return int(slot)


@compiled
def measure_centre_distances(
    points: Floats,
    origin: Floats,
    side: float,
    keys: Ints,
    cell_bounds: tuple[Ints, Ints],
    centre_distances: Floats,
) -> None:
    """Write each point's Chebyshev distance from its cell's centre, in cell sides.

    The distance is infinite outside occupied cells. `keys` are the keys of the occupied cells minus
    the lower of `cell_bounds`.
    """
    low, high = cell_bounds
    size = 4
    while size < 4 * len(keys):
        size *= 2
    slots = np.full(size, -1)
    for k in range(len(keys)):
        slots[_slot(slots, keys, keys[k])] = k
    for i in range(len(points)):
        key, farthest = 0, 0.0
        for axis in range(3):
            position = (points[i, axis] - origin[axis]) / side
            if low[axis] - 0.5 < position < high[axis] + 0.5:
                centre = np.rint(position)
                key = key << _BITS | (int(centre) - low[axis])
                farthest = max(farthest, abs(position - centre))
            else:
                farthest = np.inf
        if farthest < np.inf and slots[_slot(slots, keys, key)] < 0:
            farthest = np.inf
        centre_distances[i] = farthest

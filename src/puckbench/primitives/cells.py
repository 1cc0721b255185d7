"""Points grouped by the cubic cells of a grid that they lie in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats, bounds
from puckbench.primitives.octree_arrays import Ints

_BITS = 21
"""Bits of a coordinate in a key."""


class CellGroups(NamedTuple):
    """Points (n, 3) by cells: occupied cells (m, 3), counts (m,) and means (m, 3) of their points.

    Cells are sorted by x, then y, then z. cell_of: (n,) the cell of each point. Means are in units
    of a cell's side.
    """

    cells: Ints
    counts: Floats
    means: Floats
    cell_of: Ints

    def order(self) -> tuple[Ints, Ints]:
        """Rows (n,) that bring the points of each cell together, and where each cell starts."""
        counts = self.counts.astype(np.int64)
        starts = np.cumsum(counts) - counts
        return _ordered(self.cell_of, starts), starts


def group_by_cell(
    points: Floats, side: float, origin: Floats | None = None, *, centred: bool = False
) -> CellGroups:
    """Group points by the cells of a grid, fastest where they are in a spatial order.

    Parameters
    ----------
    points
        (n, 3), n > 0.
    side
        Side of a cell; the points extend over fewer than 2^21 of them.
    origin
        (3,) a corner of the grid; without it, zeros.
    centred
        Whether that is the centre of cell (0, 0, 0), else it is the cell's least corner.
    """
    origin = np.zeros(3) if origin is None else origin
    low, _ = bounds(points)
    first = _cell((low - origin) / side, centred)
    keys, sums, cell_of = _grouped(points, origin, side, centred, first)
    order = np.argsort(keys)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    keys, sums = keys[order], sums[order]
    mask = (1 << _BITS) - 1
    cells = np.stack([keys >> 2 * _BITS, keys >> _BITS & mask, keys & mask], axis=1) + first
    return CellGroups(cells, sums[:, 3], sums[:, :3] / sums[:, 3:], rank[cell_of])


def cell_keys(cells: Ints) -> Ints:
    """One integer (n,) for each cell (n, 3), of coordinates from 0 to 2^21; sorted as cells are."""
    return (cells[:, 0] << 2 * _BITS) | (cells[:, 1] << _BITS) | cells[:, 2]


def _cell(places: Floats, centred: bool) -> Ints:
    return np.asarray((np.rint(places) if centred else np.floor(places)).astype(np.int64))


@compiled
def _grouped(
    points: Floats, origin: Floats, side: float, centred: bool, first: Ints
) -> tuple[Ints, Floats, Ints]:
    """Keys (m,) of the occupied cells in the order met, sums (m, 4) of x, y, z, 1; cells (n,)."""
    cell_of = np.empty(len(points), np.int64)
    keys, sums = np.empty(1024, np.int64), np.zeros((1024, 4))
    slots = np.full(4096, -1)
    count, last, row = 0, -1, -1
    for i in range(len(points)):
        x = (points[i, 0] - origin[0]) / side
        y = (points[i, 1] - origin[1]) / side
        z = (points[i, 2] - origin[2]) / side
        if centred:
            a, b, c = int(np.rint(x)), int(np.rint(y)), int(np.rint(z))
        else:
            a, b, c = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        key = ((a - first[0]) << 2 * _BITS) | ((b - first[1]) << _BITS) | (c - first[2])
        if key != last:
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
            last, row = key, slots[slot]
        sums[row, 0] += x
        sums[row, 1] += y
        sums[row, 2] += z
        sums[row, 3] += 1.0
        cell_of[i] = row
    return keys[:count], sums[:count], cell_of


@compiled
def _ordered(cell_of: Ints, starts: Ints) -> Ints:
    """Stable order of the points by their cells (counting sort)."""
    order, ahead = np.empty_like(cell_of), starts.copy()
    for i in range(len(cell_of)):
        order[ahead[cell_of[i]]] = i
        ahead[cell_of[i]] += 1
    return order


@compiled
def _slot(slots: Ints, keys: Ints, key: int) -> int:
    """Where a table of a power of two of places has a key, or would have it."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = np.int64(mixed >> np.uint64(20)) & (len(slots) - 1)
    while slots[slot] >= 0 and keys[slots[slot]] != key:
        slot = (slot + 1) & (len(slots) - 1)
    return int(slot)


@compiled
def look_up_cells(
    points: Floats,
    origin: Floats,
    side: float,
    keys: Ints,
    ends: tuple[Ints, Ints],
    off_centre: Floats,
) -> None:
    """Find the cell of a grid that each point is in, and how far from its centre.

    Parameters
    ----------
    points
        (n, 3), of any finite coordinates.
    origin, side
        Centre (3,) of cell (0, 0, 0), and the side of a cell.
    keys
        (m,) distinct, of the occupied cells less the least.
    ends
        Least and largest coordinates (3,) of the occupied cells.
    off_centre
        (n,) written: the distance in cells along the axis where it is largest; infinite where a
        point's cell is not occupied.
    """
    low, high = ends
    size = 4
    while size < 4 * len(keys):
        size *= 2
    slots = np.full(size, -1)
    for k in range(len(keys)):
        slots[_slot(slots, keys, keys[k])] = k
    for i in range(len(points)):
        key, farthest = 0, 0.0
        for axis in range(3):
            place = (points[i, axis] - origin[axis]) / side
            if low[axis] - 0.5 < place < high[axis] + 0.5:
                nearest = np.rint(place)
                key = key << _BITS | (int(nearest) - low[axis])
                farthest = max(farthest, abs(place - nearest))
            else:
                farthest = np.inf
        if farthest < np.inf and slots[_slot(slots, keys, key)] < 0:
            farthest = np.inf
        off_centre[i] = farthest

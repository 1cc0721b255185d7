"""Points sorted along a Morton curve, and their distinct coordinates.

Neighbours on the curve are neighbours in space, so that searches in a tree find what they need in
the processor's cache: four times faster on a million points than in random order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats
from puckbench.geometry.morton import spread

Rows = NDArray[np.int64]
Keys = NDArray[np.int64]

VOXELS_PER_AXIS = 1 << 16
DIGIT_BITS = 12
DIGITS = 4


def distinct_rows(points: Floats) -> Rows:
    """Rows (m,) of the distinct points among `points` (n, 3), in the order of a Morton curve.

    Of points with equal coordinates the first in the array is taken, as MPEG's pc_error does.
    """
    keys = _keys(points)
    order = _sorting_order(keys)
    return order[_first_of_equals(points.take(order, axis=0) + 0.0, keys[order])]


def morton_order(points: Floats) -> Rows:
    """Rows (n,) of `points` (n, 3) in the order of a Morton curve."""
    return _sorting_order(_keys(points))


def _keys(points: Floats) -> Keys:
    lowest, highest = _bounds(points)
    extent = float(np.max(highest - lowest))
    return _morton_keys(points, lowest, (VOXELS_PER_AXIS - 1) / extent if extent > 0 else 0.0)


@compiled
def _bounds(points: Floats) -> tuple[Floats, Floats]:
    """Lowest and highest coordinates; ten times faster than numpy along the long axis."""
    lowest, highest = points[0].copy(), points[0].copy()
    for i in range(len(points)):
        for axis in range(3):
            lowest[axis] = min(lowest[axis], points[i, axis])
            highest[axis] = max(highest[axis], points[i, axis])
    return lowest, highest


@compiled
def _morton_keys(points: Floats, lowest: Floats, voxels_per_unit: float) -> Keys:
    """Interleave the bits of each point's three voxel coordinates, x lowest."""
    keys = np.empty(len(points), np.int64)
    for i in range(len(points)):
        x = spread(int((points[i, 0] - lowest[0]) * voxels_per_unit))
        y = spread(int((points[i, 1] - lowest[1]) * voxels_per_unit))
        z = spread(int((points[i, 2] - lowest[2]) * voxels_per_unit))
        keys[i] = x | (y << 1) | (z << 2)
    return keys


@compiled
def _sorting_order(keys: Keys) -> Rows:
    """Stable order of the keys, by radix sort."""
    order, target = np.arange(len(keys)), np.empty(len(keys), np.int64)
    mask = (1 << DIGIT_BITS) - 1
    for digit in range(DIGITS):
        shift = digit * DIGIT_BITS
        places = np.zeros(mask + 2, np.int64)
        for key in keys:
            places[((key >> shift) & mask) + 1] += 1
        places = np.cumsum(places)
        for row in order:
            value = (keys[row] >> shift) & mask
            target[places[value]] = row
            places[value] += 1
        order, target = target, order
    return order


@compiled
def _first_of_equals(points: Floats, keys: Keys) -> Rows:
    """Positions of the points that differ from all before them; equal points have equal keys."""
    n = len(points)
    slots = np.full(1 << int(np.ceil(np.log2(2 * n + 1))), -1, np.int64)
    kept, count = np.empty(n, np.int64), 0
    for i in range(n):
        alone = (i == 0 or keys[i] != keys[i - 1]) and (i == n - 1 or keys[i] != keys[i + 1])
        if not alone:
            slot = _hash(points[i]) & (len(slots) - 1)
            while slots[slot] >= 0 and not _equal(points[slots[slot]], points[i]):
                slot = (slot + 1) & (len(slots) - 1)
            if slots[slot] >= 0:
                continue
            slots[slot] = i
        kept[count] = i
        count += 1
    return kept[:count]


@compiled
def _equal(a: Floats, b: Floats) -> bool:
    return bool(a[0] == b[0] and a[1] == b[1] and a[2] == b[2])


@compiled
def _hash(point: Floats) -> np.int64:
    """A non-negative integer that depends on every bit of the coordinates (FNV-1a by words)."""
    mixed = np.uint64(0xCBF29CE484222325)
    for word in point.view(np.uint64):
        mixed = (mixed ^ word) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return np.int64(mixed >> np.uint64(1))

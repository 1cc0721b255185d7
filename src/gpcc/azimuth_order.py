"""Sorting of points by azimuth, radius and slope (height / radius), as in TMC13.

Points with equal keys are in the order of TMC13's unstable ``std::sort``, which is the introsort of
the GNU C++ library.
"""

from __future__ import annotations

import math

import numpy as np

from gpcc.compiled import entry, integer
from pointkit.compiling import inlined
from pointkit.geometry.cloud import Floats
from pointkit.geometry.morton import Ints

_SMALL = 16
_DEEPEST = 128


def azimuth_order(around: Ints, precision: float) -> Ints:
    """Return the indices (n,) that sort points by azimuth, then by radius, then by slope.

    Parameters
    ----------
    around
        Integer coordinates (n, 3) relative to the sensor.
    precision
        Azimuth steps per radian. Azimuths within a step count as equal; 0 compares exact azimuths.
    """
    keys = np.empty((len(around), 3))
    _fill_keys(around, precision, keys)
    rows = np.arange(len(around))
    if not _sort(rows, keys, np.empty((_DEEPEST, 3), dtype=np.int64)):
        rows = np.lexsort(keys.T[::-1])
    return rows


@entry
def _fill_keys(around: Ints, precision: float, keys: Floats) -> None:
    for i in range(len(around)):
        x, y, z = around[i, 0], around[i, 1], around[i, 2]
        angle = math.atan2(y, x)
        if precision:
            steps = math.floor(abs(angle * precision) + 0.5)
            angle = -steps if angle < 0 else steps
        radius = math.hypot(x, y)
        keys[i, 0] = angle
        keys[i, 1] = radius
        keys[i, 2] = z / radius


@entry
def _sort(rows: Ints, keys: Floats, stack: Ints) -> bool:
    """Sort `rows` in place by their keys, and return False if quicksort partitions too deeply."""
    depth, limit = 1, 0
    while len(rows) >> limit > 1:
        limit += 1
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, len(rows), 2 * limit
    while depth:
        depth -= 1
        first, end, left = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        while end - first > _SMALL:
            if left == 0 or depth == len(stack):
                return False
            left -= 1
            cut = _parted(rows, keys, first, end)
            stack[depth, 0], stack[depth, 1], stack[depth, 2] = cut, end, left
            depth += 1
            end = cut
    for i in range(1, len(rows)):
        _insert(rows, keys, i)
    return True


@inlined
def _is_before(keys: Floats, a: int, b: int) -> bool:
    column = 0
    while column < 2 and keys[a, column] == keys[b, column]:
        column += 1
    before: bool = keys[a, column] < keys[b, column]
    return before


@inlined
def _parted(rows: Ints, keys: Floats, first: int, end: int) -> int:
    chosen = _median(rows, keys, first + 1, first + (end - first) // 2, end - 1)
    rows[first], rows[chosen] = rows[chosen], rows[first]
    pivot = integer(rows[first])
    low, high = first + 1, end
    while True:
        while low < end - 1 and _is_before(keys, rows[low], pivot):
            low += 1
        high -= 1
        while high > first and _is_before(keys, pivot, rows[high]):
            high -= 1
        if low >= high:
            return low
        rows[low], rows[high] = rows[high], rows[low]
        low += 1


@inlined
def _median(rows: Ints, keys: Floats, a: int, b: int, c: int) -> int:
    if _is_before(keys, rows[a], rows[b]):
        if _is_before(keys, rows[b], rows[c]):
            return b
        return c if _is_before(keys, rows[a], rows[c]) else a
    if _is_before(keys, rows[a], rows[c]):
        return a
    return c if _is_before(keys, rows[b], rows[c]) else b


@inlined
def _insert(rows: Ints, keys: Floats, place: int) -> None:
    row = integer(rows[place])
    while place > 0 and _is_before(keys, row, rows[place - 1]):
        rows[place] = rows[place - 1]
        place -= 1
    rows[place] = row

"""The order in which points are coded, and the groups of points that are coded at once.

A group is predicted from all groups before it. The first is stored. Each of the others is twice as
large as the one before, up to a maximum (progressive random grouping).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pcc_networks.polopcac.inference import NEIGHBOURS

_FIRST_PART = 128
MAX_GROUP = 2**14
"""Greatest number of points of a group."""
_GROWTH = 2
_STRIDE = np.uint64(0x9E3779B97F4A7C15)
_MIXERS = (
    (np.uint64(30), np.uint64(0xBF58476D1CE4E5B9)),
    (np.uint64(27), np.uint64(0x94D049BB133111EB)),
)
_LAST_SHIFT = np.uint64(31)


def first_group(points: int) -> int:
    """Return the number of points that are stored: a 128th, but enough neighbours for the next."""
    part = max(points // _FIRST_PART, NEIGHBOURS)
    return min(part, MAX_GROUP, points)


def groups(points: int) -> Iterator[slice]:
    """Yield the groups of points after the first, as slices of the coding order."""
    size = start = first_group(points)
    while start < points:
        size = min(size * _GROWTH, MAX_GROUP)
        yield slice(start, min(start + size, points))
        start += size


def shuffled(points: int) -> NDArray[np.int64]:
    """Return the numbers from 0 to ``points - 1`` in an order that looks random, always the same.

    They are sorted by the generator SplitMix64, which gives no number twice.
    """
    numbers = np.arange(1, points + 1, dtype=np.uint64) * _STRIDE
    for shift, factor in _MIXERS:
        numbers = (numbers ^ (numbers >> shift)) * factor
    return np.argsort(numbers ^ (numbers >> _LAST_SHIFT))

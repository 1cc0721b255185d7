"""Occupancy of a voxel's eight children as two symbols, their frequencies, and groups of voxels.

The first symbol of four bits holds the children whose coordinates have an even sum, the second the
others: children of one kind share faces with the other kind alone, so that the first symbol tells
most about the second.
"""

from __future__ import annotations

from decimal import Decimal
from functools import cache

import numpy as np
from numpy.typing import NDArray

from puckbench.learned.octree_net.fixed_point import UNITS
from puckbench.learned.sparse.voxels import CHILDREN, Keys

Symbols = NDArray[np.uint8]
Frequencies = NDArray[np.int32]
"""Frequencies (n, 16) of the values of n symbols."""

EVEN, ODD = (0, 3, 5, 6), (1, 2, 4, 7)
VALUES = 16
GROUPS = 4
"""Groups of voxels, coded one after the other. The four voxels of a square on a plane at right
angles to an axis are in four groups, so that three of the four know where the plane lies."""
_GROUP = np.array([0, 1, 2, 3, 3, 2, 1, 0])
_CODES = np.arange(256)
_FREQUENCY_BITS = 16
_MIN_FREQUENCY = 8


def _half(children: tuple[int, ...]) -> Symbols:
    """For each of the 256 occupancies, the symbol of four of the children."""
    bits = (_CODES[:, None] >> np.array(children)) & 1
    return np.asarray(bits @ (1 << np.arange(len(children))), dtype=np.uint8)


_FIRST, _SECOND = _half(EVEN), _half(ODD)
_CODE = np.empty((VALUES, VALUES), dtype=np.uint8)
_CODE[_FIRST, _SECOND] = _CODES


def symbols_of(keys: Keys) -> tuple[Symbols, Symbols]:
    """First and second symbols (m,) of the parents of voxels in Morton order."""
    starts = np.flatnonzero(np.diff(keys >> 3, prepend=-1))
    bits = (1 << (keys & 7)).astype(np.uint8)
    codes = np.add.reduceat(bits, starts)
    return _FIRST[codes], _SECOND[codes]


def groups_of(keys: Keys) -> list[NDArray[np.int64]]:
    """Rows of the voxels of each group, ascending; opposite corners of a block are of one group."""
    group = _GROUP[keys & 7]
    return [np.flatnonzero(group == g) for g in range(GROUPS)]


def slots_of(first: Symbols, second: Symbols) -> NDArray[np.int64]:
    """Slots ``8 * parent + child`` of the occupied children, ascending."""
    codes = _CODE[first, second]
    occupied = (codes[:, None] >> np.arange(CHILDREN, dtype=np.uint8)) & 1
    return np.flatnonzero(occupied)


@cache
def powers_of_two() -> Frequencies:
    """2**16 times 2**(-d / UNITS), rounded, for d = 0, 1, .. until `_MIN_FREQUENCY` is reached."""
    steps = range((_FREQUENCY_BITS - 3) * UNITS + 1)
    exact = [Decimal(2) ** (_FREQUENCY_BITS - Decimal(d) / UNITS) for d in steps]
    return np.array([round(power) for power in exact], dtype=np.int32)


def frequencies(logits: NDArray[np.float32]) -> Frequencies:
    """Integer frequencies of symbols from their logits.

    Parameters
    ----------
    logits
        (n, 16), to the base 2, multiples of 1 / UNITS.

    Returns
    -------
    NDArray
        (n, 16): 65,536 for the most likely value, at least 8 for any other.
    """
    units = logits * np.float32(UNITS)
    below = (units.max(axis=1, keepdims=True) - units).astype(np.int32)
    table = powers_of_two()
    np.minimum(below, len(table) - 1, out=below)
    return np.asarray(table[below])

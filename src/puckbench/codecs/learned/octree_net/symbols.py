"""Occupancy of a voxel's eight children as two symbols of four bits, and groups of voxels.

The first symbol holds the children whose coordinates have an even sum, the second the others:
the faces of one kind touch the other kind alone, so that the first tells most about the second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.sparse.voxels import CHILDREN, Keys

Symbols = NDArray[np.uint8]

EVEN, ODD = (0, 3, 5, 6), (1, 2, 4, 7)
VALUES = 16
GROUPS = 4
"""Of voxels, coded one group after the other. Of a square of four voxels on a plane at right angles
to an axis each is in another group, so that three of the four know where the plane lies."""
_GROUP = np.array([0, 1, 2, 3, 3, 2, 1, 0])
_CODES = np.arange(256)


def _half(children: tuple[int, ...]) -> Symbols:
    """For each of the 256 occupancies, the symbol of some of the children."""
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

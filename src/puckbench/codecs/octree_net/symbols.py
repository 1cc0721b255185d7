"""Occupancy of a voxel's eight children as two symbols of four bits: a checkerboard.

The first symbol holds the children whose coordinates have an even sum, the second the others. A
child of the second has no face in common with another one of its kind, within its parent or
beyond: once all first symbols are known, so are all of its six face neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.sparse.voxels import CHILDREN, Keys

Symbols = NDArray[np.uint8]

EVEN, ODD = (0, 3, 5, 6), (1, 2, 4, 7)
VALUES = 16
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


def slots_of(first: Symbols, second: Symbols) -> NDArray[np.int64]:
    """Slots ``8 * parent + child`` of the occupied children, ascending."""
    codes = _CODE[first, second]
    occupied = (codes[:, None] >> np.arange(CHILDREN, dtype=np.uint8)) & 1
    return np.flatnonzero(occupied)

"""Occupancy of a voxel's eight children as two 4-bit symbols, and groups of voxels.

The first symbol holds the four children with an even sum of coordinates, the second those with an
odd sum. Only children of different symbols share faces, so that one symbol predicts the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcc_networks.sparse.voxels import Keys, occupancies, slots_of_occupancies

Symbols = NDArray[np.uint8]
Frequencies = NDArray[np.int32]
"""Frequencies (n, 16) of the values of symbols."""

EVEN, ODD = (0, 3, 5, 6), (1, 2, 4, 7)
VALUES = 16
GROUPS = 4
"""Number of groups of voxels, coded one after another. The four voxels of a layer of a 2x2x2 block
are in different groups, so that the first group shows where a plane lies."""
_GROUP = np.array([0, 1, 2, 3, 3, 2, 1, 0])
_CODES = np.arange(256)


def _half(children: tuple[int, ...]) -> Symbols:
    """Return, for each of the 256 occupancies, the symbol that four of the children form."""
    bits = (_CODES[:, None] >> np.array(children)) & 1
    return np.asarray(bits @ (1 << np.arange(len(children))), dtype=np.uint8)


_FIRST, _SECOND = _half(EVEN), _half(ODD)
_CODE = np.empty((VALUES, VALUES), dtype=np.uint8)
_CODE[_FIRST, _SECOND] = _CODES


def symbols_of(keys: Keys) -> tuple[Symbols, Symbols]:
    codes = occupancies(keys)
    return _FIRST[codes], _SECOND[codes]


def groups_of(keys: Keys) -> list[NDArray[np.int64]]:
    """Return the ascending rows of each group; opposite corners of a 2x2x2 block share a group."""
    group = _GROUP[keys & 7]
    return [np.flatnonzero(group == g) for g in range(GROUPS)]


def slots_of(first: Symbols, second: Symbols) -> NDArray[np.int64]:
    return slots_of_occupancies(_CODE[first, second])

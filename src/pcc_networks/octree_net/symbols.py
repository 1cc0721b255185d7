"""Division of a voxel's occupancy into two symbols, and of a level's voxels into groups.

An occupancy says which of the eight children of a voxel are occupied. The first symbol (4 bits)
holds the four children with an even sum of coordinates, the second symbol those with an odd sum.
Children share faces only with children of the other symbol, so that one symbol predicts the other.
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
    """Return the symbol that four of the children form, for each of the 256 occupancies."""
    bits = (_CODES[:, None] >> np.array(children)) & 1
    return np.asarray(bits @ (1 << np.arange(len(children))), dtype=np.uint8)


_FIRST, _SECOND = _half(EVEN), _half(ODD)
_CODE = np.empty((VALUES, VALUES), dtype=np.uint8)
_CODE[_FIRST, _SECOND] = _CODES


def symbols_of(keys: Keys) -> tuple[Symbols, Symbols]:
    """Return the first and second symbols (m,) of the parents of voxels with sorted keys (n,)."""
    codes = occupancies(keys)
    return _FIRST[codes], _SECOND[codes]


def groups_of(keys: Keys) -> list[NDArray[np.int64]]:
    """Return the rows of each group, for voxels with keys (n,).

    Opposite corners of a 2x2x2 block belong to the same group.
    """
    group = _GROUP[keys & 7]
    return [np.flatnonzero(group == g) for g in range(GROUPS)]


def slots_of(first: Symbols, second: Symbols) -> NDArray[np.int64]:
    """Return the slots (see `sparse.voxels`) of the children that symbols (m,) declare occupied."""
    return slots_of_occupancies(_CODE[first, second])

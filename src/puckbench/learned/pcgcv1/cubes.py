"""Voxels in cubes of a fixed side, and the most likely voxels of a cube."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.learned.point_reconstruction import SiblingBlocks, sibling_blocks

Whole = NDArray[np.int64]
Voxels = NDArray[np.int64]
S = TypeVar("S", bound=np.generic)


@dataclass(frozen=True)
class OccupiedCubes:
    """Occupied cubes in the order of their positions.

    Parameters
    ----------
    side
        Voxels along an edge.
    positions
        (m, 3), in cubes.
    starts
        (m + 1,), cube k has keys[starts[k] : starts[k + 1]].
    keys
        (n,), of each voxel within its cube, ``(x * side + y) * side + z``, ascending in a cube.
    """

    side: int
    positions: Voxels
    starts: Whole
    keys: Whole

    @property
    def counts(self) -> Whole:
        """Voxels of each cube."""
        return np.diff(self.starts)

    def selected(self, mask: NDArray[np.bool_]) -> OccupiedCubes:
        """The cubes where a mask (m,) holds."""
        kept = np.repeat(mask, self.counts)
        starts = np.append(0, np.cumsum(self.counts[mask]))
        return OccupiedCubes(self.side, self.positions[mask], starts, self.keys[kept])

    def keys_of(self, cube: int) -> Whole:
        """The keys of one cube's voxels."""
        return self.keys[self.starts[cube] : self.starts[cube + 1]]

    def voxels(self) -> Voxels:
        """The voxels (n, 3) of all cubes."""
        corners = np.repeat(self.positions, self.counts, axis=0) * self.side
        return corners + voxels_of_keys(self.keys, self.side)


def voxels_of_keys(keys: Whole, side: int) -> Voxels:
    """Voxels (n, 3) within a cube, of keys (n,)."""
    return np.column_stack([keys // side**2, keys // side % side, keys % side])


def in_order(positions: NDArray[np.integer[Any]]) -> Voxels:
    """Positions (m, 3) in the order in which cubes are coded: by x, then y, then z."""
    rows = np.asarray(positions, dtype=np.int64)
    return rows[np.lexsort(rows.T[::-1])]


def cubes_of(voxels: Voxels, side: int) -> OccupiedCubes:
    """The cubes, at multiples of `side`, of voxels (n, 3) in any order, with duplicates or not."""
    above = voxels // side
    x, y, z = (voxels - above * side).T
    keys = (x * side + y) * side + z
    order = np.lexsort((keys, *above.T[::-1]))
    rows = np.column_stack([above[order], keys[order]])
    rows = rows[np.append(True, (np.diff(rows, axis=0) != 0).any(axis=1))]
    begins = np.append(True, (np.diff(rows[:, :3], axis=0) != 0).any(axis=1))
    starts = np.append(np.flatnonzero(begins), len(rows))
    return OccupiedCubes(side, rows[begins, :3], starts, rows[:, 3])


def occupancy(keys: Whole, side: int) -> NDArray[np.float32]:
    """Ones at the keys of a cube, zeros elsewhere: (side, side, side)."""
    flat = np.zeros(side**3, dtype=np.float32)
    flat[keys] = 1
    return flat.reshape(side, side, side)


def most_likely(logits: NDArray[np.float32], count: int) -> Whole:
    """Keys of the `count` largest logits of a cube, ascending; of equal ones the first."""
    if count >= len(logits):
        return np.arange(len(logits))
    least = np.partition(logits, len(logits) - count)[len(logits) - count]
    above = np.flatnonzero(logits > least)
    equal = np.flatnonzero(logits == least)[: count - len(above)]
    return np.sort(np.concatenate([above, equal]))


def sibling_blocks_of(logits: NDArray[np.float32], keys: Whole) -> SiblingBlocks:
    """The 2x2x2 blocks of a cube by its flat logits (side**3,) and the keys of voxels to keep."""
    kept = np.zeros(len(logits), dtype=bool)
    kept[keys] = True
    across = round(len(logits) ** (1 / 3)) // 2
    places = voxels_of_keys(np.arange(across**3), across)
    return sibling_blocks(places, _by_block(logits, across), _by_block(kept, across))


def _by_block(values: NDArray[S], across: int) -> NDArray[S]:
    """Flat values of a cube's voxels to (blocks, 8), x fastest in a block."""
    return values.reshape((across, 2) * 3).transpose(0, 2, 4, 5, 3, 1).reshape(-1, 8)

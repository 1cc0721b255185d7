"""Cubes of voxels, and which of their blocks are occupied.

A block is the 4x4x4 voxels of one position of the latent. Networks trained with occupied blocks, an
addition to the paper, omit the latent of empty blocks. The decoder places voxels in all occupied
blocks and none elsewhere, which avoids holes and outliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcc_networks.point_reconstruction import SiblingBlocks, sibling_blocks
from pcc_networks.sparse.voxels import top_k

Int64s = NDArray[np.int64]
Voxels = NDArray[np.int64]
S = TypeVar("S", bound=np.generic)


@dataclass(frozen=True)
class OccupiedCubes:
    side: int  # voxels along an edge
    positions: Voxels  # (m, 3), in cubes
    starts: Int64s  # (m + 1,); cube k has keys[starts[k] : starts[k + 1]]
    keys: Int64s  # (n,), (x * side + y) * side + z within the cube, ascending in a cube

    @property
    def counts(self) -> Int64s:
        return np.diff(self.starts)

    def selected(self, mask: NDArray[np.bool_]) -> OccupiedCubes:
        kept = np.repeat(mask, self.counts)
        starts = np.append(0, np.cumsum(self.counts[mask]))
        return OccupiedCubes(self.side, self.positions[mask], starts, self.keys[kept])

    def keys_of(self, cube: int) -> Int64s:
        return self.keys[self.starts[cube] : self.starts[cube + 1]]

    def voxels(self) -> Voxels:
        corners = np.repeat(self.positions, self.counts, axis=0) * self.side
        return corners + voxels_of_keys(self.keys, self.side)


def voxels_of_keys(keys: Int64s, side: int) -> Voxels:
    return np.column_stack([keys // side**2, keys // side % side, keys % side])


def in_order(positions: NDArray[np.integer[Any]]) -> Voxels:
    """Sort positions (m, 3) by x, then y, then z, the order in which cubes are coded."""
    rows = np.asarray(positions, dtype=np.int64)
    return rows[np.lexsort(rows.T[::-1])]


def cubes_of(voxels: Voxels, side: int) -> OccupiedCubes:
    """Divide voxels (n, 3), in any order and with duplicates, into cubes."""
    cube_positions = voxels // side
    x, y, z = (voxels - cube_positions * side).T
    keys = (x * side + y) * side + z
    order = np.lexsort((keys, *cube_positions.T[::-1]))
    rows = np.column_stack([cube_positions[order], keys[order]])
    rows = rows[np.append(True, (np.diff(rows, axis=0) != 0).any(axis=1))]
    begins = np.append(True, (np.diff(rows[:, :3], axis=0) != 0).any(axis=1))
    starts = np.append(np.flatnonzero(begins), len(rows))
    return OccupiedCubes(side, rows[begins, :3], starts, rows[:, 3])


def occupancy(keys: Int64s, side: int) -> NDArray[np.float32]:
    flat = np.zeros(side**3, dtype=np.float32)
    flat[keys] = 1
    return flat.reshape(side, side, side)


def sibling_blocks_of(logits: NDArray[np.float32], keys: Int64s) -> SiblingBlocks:
    """Return the 2x2x2 blocks of a cube, from its logits (side**3,) and the keys of kept voxels."""
    kept = np.zeros(len(logits), dtype=bool)
    kept[keys] = True
    across = round(len(logits) ** (1 / 3)) // 2
    block_positions = voxels_of_keys(np.arange(across**3), across)
    return sibling_blocks(block_positions, _by_block(logits, across), _by_block(kept, across))


def _by_block(values: NDArray[S], across: int) -> NDArray[S]:
    return values.reshape((across, 2) * 3).transpose(0, 2, 4, 5, 3, 1).reshape(-1, 8)


STRIDE = 4
"""Voxels along an edge of a block; the hyper-latent has one position per 2x2x2 blocks."""
Bools = NDArray[np.bool_]
N = TypeVar("N", bound=np.number[Any])


@dataclass(frozen=True)
class CodedCubes:
    positions: Voxels  # (m, 3), in cubes, sorted
    blocks: Bools  # (m, s, s, s), where the latent is coded


def cubes_with_all_blocks(positions: Voxels, side: int) -> CodedCubes:
    ordered, blocks = in_order(positions), side // STRIDE
    return CodedCubes(ordered, np.ones((len(ordered), blocks, blocks, blocks), dtype=bool))


def blocks_of(cubes: OccupiedCubes) -> Voxels:
    rows: Voxels = np.unique(cubes.voxels() // STRIDE, axis=0)
    return rows


def cubes_with_blocks(blocks: Voxels, side: int) -> CodedCubes:
    across = side // STRIDE
    positions, cube = np.unique(blocks // across, axis=0, return_inverse=True)
    occupied = np.zeros((len(positions), across, across, across), dtype=bool)
    occupied[(cube.ravel(), *(blocks % across).T)] = True
    return CodedCubes(positions.reshape(-1, 3), occupied)


def pooled(blocks: Bools) -> Bools:
    """Reduce (m, s, s, s) to (m, s / 2, s / 2, s / 2), true where any of eight values is true."""
    m, s = len(blocks), blocks.shape[-1] // 2
    return np.asarray(blocks.reshape(m, s, 2, s, 2, s, 2).any(axis=(2, 4, 6)))


def rows_of(values: NDArray[N], blocks: Bools) -> NDArray[N]:
    """Return rows (n, channels) of values (m, channels, s, s, s) at true blocks (m, s, s, s)."""
    return np.moveaxis(values, 1, -1)[blocks]


def most_likely_per_block(logits: NDArray[np.float32], blocks: Bools, count: int) -> Int64s:
    """Return the ascending keys of the `count` voxels of a cube that a decoder keeps.

    The most likely voxel of each occupied block (s, s, s) has priority; the other voxels are ranked
    by their logits (side**3,).
    """
    side = blocks.shape[0] * STRIDE
    rows = _in_blocks(logits.reshape(side, side, side))[blocks]
    rows[np.arange(len(rows)), rows.argmax(axis=1)] = np.inf
    keys: Int64s = _keys(side)[blocks].ravel()[top_k(rows.ravel(), count)]
    return np.sort(keys)


@cache
def _keys(side: int) -> Int64s:
    return _in_blocks(np.arange(side**3).reshape(side, side, side))


def _in_blocks(values: NDArray[N]) -> NDArray[N]:
    s = len(values) // STRIDE
    split = values.reshape(s, STRIDE, s, STRIDE, s, STRIDE)
    return split.transpose(0, 2, 4, 1, 3, 5).reshape(s, s, s, STRIDE**3)

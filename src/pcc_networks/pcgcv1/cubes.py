"""Division of voxels into cubes, and of cubes into blocks that are occupied or empty.

A block is the 4x4x4 voxels that correspond to one position of the latent. Networks that are trained
with occupied blocks, an addition to the paper, omit the latent of empty blocks. The decoder then
places voxels in all occupied blocks and in no others, which avoids holes and outliers.
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
    """Occupied voxels, grouped by the cubes that contain them."""

    side: int  # voxels along an edge
    positions: Voxels  # (m, 3), in cubes
    starts: Int64s  # (m + 1,); cube k has keys[starts[k] : starts[k + 1]]
    keys: Int64s  # (n,), (x * side + y) * side + z within the cube, ascending in a cube

    @property
    def counts(self) -> Int64s:
        """Number of voxels of each cube (m,)."""
        return np.diff(self.starts)

    def selected(self, mask: NDArray[np.bool_]) -> OccupiedCubes:
        """Return only the cubes for which the mask (m,) is true."""
        kept = np.repeat(mask, self.counts)
        starts = np.append(0, np.cumsum(self.counts[mask]))
        return OccupiedCubes(self.side, self.positions[mask], starts, self.keys[kept])

    def keys_of(self, cube: int) -> Int64s:
        """Return the keys of the voxels of the cube with this index."""
        return self.keys[self.starts[cube] : self.starts[cube + 1]]

    def voxels(self) -> Voxels:
        """Return the voxels (n, 3) of all cubes."""
        corners = np.repeat(self.positions, self.counts, axis=0) * self.side
        return corners + voxels_of_keys(self.keys, self.side)


def voxels_of_keys(keys: Int64s, side: int) -> Voxels:
    """Return the positions (n, 3) within a cube of voxels with keys (n,)."""
    return np.column_stack([keys // side**2, keys // side % side, keys % side])


def in_order(positions: NDArray[np.integer[Any]]) -> Voxels:
    """Sort positions (m, 3) by x, then y, then z, which is the order in which cubes are coded."""
    rows = np.asarray(positions, dtype=np.int64)
    return rows[np.lexsort(rows.T[::-1])]


def cubes_of(voxels: Voxels, side: int) -> OccupiedCubes:
    """Divide voxels (n, 3), in any order and with duplicates, into cubes of `side` voxels."""
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
    """Return an array (side, side, side) that is 1 at the voxels with these keys, and else 0."""
    flat = np.zeros(side**3, dtype=np.float32)
    flat[keys] = 1
    return flat.reshape(side, side, side)


def sibling_blocks_of(logits: NDArray[np.float32], keys: Int64s) -> SiblingBlocks:
    """Return the 2x2x2 blocks of a cube in which voxels are kept.

    Parameters
    ----------
    logits
        Logits (side**3,) of the occupancy of all voxels of the cube.
    keys
        Keys of the kept voxels.
    """
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
    """The cubes that the network codes, and the blocks in which the latent is coded."""

    positions: Voxels  # (m, 3), in cubes, sorted
    blocks: Bools  # (m, s, s, s), where the latent is coded


def cubes_with_all_blocks(positions: Voxels, side: int) -> CodedCubes:
    """Return cubes in which the latent is coded in all blocks, for positions (m, 3) of cubes."""
    ordered, blocks = in_order(positions), side // STRIDE
    return CodedCubes(ordered, np.ones((len(ordered), blocks, blocks, blocks), dtype=bool))


def blocks_of(cubes: OccupiedCubes) -> Voxels:
    """Return the positions (n, 3) of the occupied blocks of cubes."""
    rows: Voxels = np.unique(cubes.voxels() // STRIDE, axis=0)
    return rows


def cubes_with_blocks(blocks: Voxels, side: int) -> CodedCubes:
    """Return cubes in which the latent is coded only in blocks at these positions (n, 3)."""
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
    """Return values at true blocks as rows.

    Parameters
    ----------
    values
        Values (m, channels, s, s, s).
    blocks
        Mask (m, s, s, s).

    Returns
    -------
    ndarray
        Values (n, channels) at the n true blocks.
    """
    return np.moveaxis(values, 1, -1)[blocks]


def most_likely_per_block(logits: NDArray[np.float32], blocks: Bools, count: int) -> Int64s:
    """Select the voxels of a cube that the decoder keeps.

    The most likely voxel of each occupied block has priority. The other voxels are ranked by their
    logits.

    Parameters
    ----------
    logits
        Logits (side**3,) of the occupancy of all voxels of the cube.
    blocks
        Whether each block (s, s, s) is occupied.
    count
        Number of voxels to keep.

    Returns
    -------
    ndarray
        Ascending keys of the kept voxels.
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

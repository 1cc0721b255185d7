"""Occupied blocks of a cube, which the stream tells the decoder beside the latent.

A block is 4x4x4 voxels, those of one position of the latent. A network that was trained for it
leaves the latent of empty blocks out; the decoder places no voxel there, and at least one in each
occupied block: no holes, no voxels far from any surface. In the paper the latent is coded
everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.learned.pcgcv1.cubes import OccupiedCubes, Voxels, Whole, in_order, most_likely

STRIDE = 4
"""Voxels along an edge of a block; the hyper-latent has a position for 2x2x2 blocks."""
Bools = NDArray[np.bool_]
N = TypeVar("N", bound=np.number[Any])


@dataclass(frozen=True)
class CodedCubes:
    """Cubes that a network codes.

    Parameters
    ----------
    positions
        (m, 3), in cubes, in order.
    blocks
        (m, s, s, s), the blocks whose latent is coded.
    """

    positions: Voxels
    blocks: Bools


def full_support(positions: Voxels, side: int) -> CodedCubes:
    """All blocks of the cubes at positions (m, 3)."""
    ordered, blocks = in_order(positions), side // STRIDE
    return CodedCubes(ordered, np.ones((len(ordered), blocks, blocks, blocks), dtype=bool))


def blocks_of(cubes: OccupiedCubes) -> Voxels:
    """Positions (n, 3), in blocks, of the occupied ones."""
    rows: Voxels = np.unique(cubes.voxels() // STRIDE, axis=0)
    return rows


def support_of(blocks: Voxels, side: int) -> CodedCubes:
    """The cubes of blocks at distinct positions (n, 3), in blocks."""
    across = side // STRIDE
    positions, cube = np.unique(blocks // across, axis=0, return_inverse=True)
    occupied = np.zeros((len(positions), across, across, across), dtype=bool)
    occupied[(cube.ravel(), *(blocks % across).T)] = True
    return CodedCubes(positions.reshape(-1, 3), occupied)


def pooled(blocks: Bools) -> Bools:
    """(m, s, s, s) to (m, s / 2, s / 2, s / 2): where any of eight is true."""
    m, s = len(blocks), blocks.shape[-1] // 2
    return np.asarray(blocks.reshape(m, s, 2, s, 2, s, 2).any(axis=(2, 4, 6)))


def rows_of(values: NDArray[N], blocks: Bools) -> NDArray[N]:
    """Values (m, channels, s, s, s) of the blocks (m, s, s, s) that are true: (n, channels)."""
    return np.moveaxis(values, 1, -1)[blocks]


def most_likely_per_block(logits: NDArray[np.float32], blocks: Bools, count: int) -> Whole:
    """The voxels of a cube that a decoder keeps: the most likely of each block, then of all.

    Parameters
    ----------
    logits
        (side**3,), of all voxels.
    blocks
        (s, s, s), the occupied blocks.
    count
        How many to keep.

    Returns
    -------
    NDArray
        Keys (count,), ascending.
    """
    side = blocks.shape[0] * STRIDE
    rows = _in_blocks(logits.reshape(side, side, side))[blocks]
    rows[np.arange(len(rows)), rows.argmax(axis=1)] = np.inf
    keys: Whole = _keys(side)[blocks].ravel()[most_likely(rows.ravel(), count)]
    return np.sort(keys)


@cache
def _keys(side: int) -> Whole:
    """Keys of the voxels of each block (s, s, s, 64)."""
    return _in_blocks(np.arange(side**3).reshape(side, side, side))


def _in_blocks(values: NDArray[N]) -> NDArray[N]:
    """(side, side, side) to (s, s, s, 64)."""
    s = len(values) // STRIDE
    split = values.reshape(s, STRIDE, s, STRIDE, s, STRIDE)
    return split.transpose(0, 2, 4, 1, 3, 5).reshape(s, s, s, STRIDE**3)

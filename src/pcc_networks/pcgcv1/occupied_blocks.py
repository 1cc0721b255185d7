"""Occupied blocks of cubes, an addition to the paper.

A block is the 4x4x4 voxels of one position of the latent. Networks trained with blocks omit the
latent of empty blocks. The decoder places voxels in all occupied blocks and none elsewhere, which
avoids holes and outliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcc_networks.pcgcv1.cubes import Int64s, OccupiedCubes, Voxels, in_order
from pcc_networks.sparse.layers import top_k

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

"""Which blocks of a cube hold voxels: what the decoder is told beside the latent.

A block is the place of one latent value, 4 x 4 x 4 voxels. A network that is trained so leaves the
latent of the other blocks out, and the decoder puts no voxel there and at least one into each block
that has one: no holes, no voxels far from any surface. The original's latent is coded everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.pcgcv1.cubes import Cubes, Voxels, Whole, in_order, most_likely

STRIDE = 4
"""Voxels along a block's edge; the hyper-latent has a value for each 2 x 2 x 2 blocks."""
Bools = NDArray[np.bool_]
N = TypeVar("N", bound=np.number[Any])


@dataclass(frozen=True)
class Support:
    """Cubes that a network codes.

    positions: (m, 3), in cubes, in order. blocks: (m, s, s, s), those that count.
    """

    positions: Voxels
    blocks: Bools


def everywhere(positions: Voxels, side: int) -> Support:
    """All blocks of cubes at these positions (m, 3)."""
    ordered, blocks = in_order(positions), side // STRIDE
    return Support(ordered, np.ones((len(ordered), blocks, blocks, blocks), dtype=bool))


def blocks_of(cubes: Cubes) -> Voxels:
    """Positions (n, 3), in blocks, of those that hold voxels."""
    rows: Voxels = np.unique(cubes.voxels() // STRIDE, axis=0)
    return rows


def support_of(blocks: Voxels, side: int) -> Support:
    """The cubes around blocks (n, 3) at different positions, in blocks."""
    across = side // STRIDE
    positions, cube = np.unique(blocks // across, axis=0, return_inverse=True)
    held = np.zeros((len(positions), across, across, across), dtype=bool)
    held[(cube.ravel(), *(blocks % across).T)] = True
    return Support(positions.reshape(-1, 3), held)


def pooled(blocks: Bools) -> Bools:
    """(m, s, s, s) to (m, s / 2, s / 2, s / 2): where any of eight is true."""
    m, s = len(blocks), blocks.shape[-1] // 2
    return np.asarray(blocks.reshape(m, s, 2, s, 2, s, 2).any(axis=(2, 4, 6)))


def rows_of(values: NDArray[N], blocks: Bools) -> NDArray[N]:
    """Values (m, channels, s, s, s) of the blocks (m, s, s, s) that are true: (n, channels)."""
    return np.moveaxis(values, 1, -1)[blocks]


def likeliest(logits: NDArray[np.float32], blocks: Bools, count: int) -> Whole:
    """Keys of `count` voxels of a cube, ascending, in its blocks (s, s, s).

    The likeliest of each block first, then the likeliest of all blocks.
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

"""Which corners of a neighbour a 3x3x3 convolution reads, and where their products go.

Two layouts of features share one algorithm. *Rows*: one voxel a row, 27 offsets, c columns.
*Blocks*: one parent a row, its eight children beside each other, 8 c columns. In blocks an offset
is that between parents; it pairs 8, 4, 2 or 1 children (itself, a face, an edge, a corner) with as
many, so that all 27 offsets of the children become 27 products that are larger and fewer, and no
product is wasted: 8 * 8 + 6 * 4 * 4 + 12 * 2 * 2 + 8 * 1 * 1 = 8 * 27.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.sparse.voxels import OFFSETS


@dataclass(frozen=True)
class Layout:
    """For each offset between rows: the children read there, and those the products go to.

    children: 1 (rows) or 8 (blocks). many: (27,) how many children. read, written: (27, 8), the
    first `many` of each row in use. kernels: for each offset (many, many), the number of the
    3x3x3 kernel that joins child read and child written.
    """

    children: int
    many: NDArray[np.int64]
    read: NDArray[np.int64]
    written: NDArray[np.int64]
    kernels: tuple[NDArray[np.int64], ...]

    @cached_property
    def sizes(self) -> list[int]:
        """`many` as plain numbers."""
        sizes: list[int] = self.many.tolist()
        return sizes

    @cached_property
    def kernel_of_pair(self) -> NDArray[np.int64]:
        """The kernel's number for each pair of children, offset by offset, read child first."""
        return np.concatenate([kernels.ravel() for kernels in self.kernels])

    @property
    def most_read(self) -> int:
        """Children that a row reads when it has every neighbour."""
        return sum(self.sizes) - self.children

    @property
    def usually_read(self) -> int:
        """Children that a row of a surface reads: about nine neighbours in a plane."""
        return most // 2 if (most := self.most_read) else 1


@cache
def rows_layout() -> Layout:
    """One voxel a row."""
    zeros = np.zeros((OFFSETS, 8), dtype=np.int64)
    kernels = tuple(np.array([[offset]]) for offset in range(OFFSETS))
    return Layout(1, np.ones(OFFSETS, dtype=np.int64), zeros, zeros, kernels)


@cache
def blocks_layout() -> Layout:
    """Eight children a row, child ``x + 2 y + 4 z``."""
    read, written = np.zeros((2, OFFSETS, 8), dtype=np.int64)
    many, kernels = np.zeros(OFFSETS, dtype=np.int64), []
    for offset in range(OFFSETS):
        steps = [offset // 3**axis % 3 - 1 for axis in range(3)]
        near = _children([{-1: 1, 0: None, 1: 0}[step] for step in steps])
        own = _children([{-1: 0, 0: None, 1: 1}[step] for step in steps])
        many[offset] = len(own)
        read[offset, : len(near)], written[offset, : len(own)] = near, own
        kernels.append(_kernel_between(near[:, None], own[None, :], steps))
    return Layout(8, many, read, written, tuple(kernels))


def _children(fixed: list[int | None]) -> NDArray[np.int64]:
    """Children whose corner has the given coordinates, None for either."""
    every = np.arange(8)
    fits = [np.ones(8, bool) if at is None else (every >> axis & 1) == at
            for axis, at in enumerate(fixed)]  # fmt: skip
    return every[np.logical_and.reduce(fits)]


def _kernel_between(
    near: NDArray[np.int64], own: NDArray[np.int64], steps: list[int]
) -> NDArray[np.int64]:
    parts = [
        (2 * step + (near >> axis & 1) - (own >> axis & 1) + 1) * 3**axis
        for axis, step in enumerate(steps)
    ]
    return np.asarray(sum(parts))

"""Kernel maps of a sparse 3x3x3 convolution: which child reads which neighbour with which kernel.

Two memory layouts share one algorithm. *Voxels*: a row is one voxel with c features, and an offset
is one between voxels. *Blocks*: a row is one parent with its eight children beside each other, 8 c
features, and an offset is one between parents; it pairs 8, 4, 2 or 1 children (the parent itself, a
face, an edge, a corner) with as many. All 27 offsets of the children then become 27 matrix products
that are larger and fewer, without any waste: 8 * 8 + 6 * 4 * 4 + 12 * 2 * 2 + 8 * 1 * 1 = 8 * 27.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from puckbench.learned.sparse.voxels import OFFSETS


@dataclass(frozen=True)
class KernelMap:
    """For each of 27 offsets between rows: the children read there, and those written to.

    Parameters
    ----------
    children
        Children of a row: 1 (voxels) or 8 (blocks).
    counts
        (27,), how many children are read, and as many written.
    read, written
        (27, 8), these children; the first `counts` of each row are in use.
    kernels
        For each offset (count, count), which of the 27 kernel matrices joins child read and child
        written.
    """

    children: int
    counts: NDArray[np.int64]
    read: NDArray[np.int64]
    written: NDArray[np.int64]
    kernels: tuple[NDArray[np.int64], ...]

    @cached_property
    def sizes(self) -> list[int]:
        """`counts` as Python integers."""
        sizes: list[int] = self.counts.tolist()
        return sizes

    @cached_property
    def groups(self) -> list[tuple[int, list[int]]]:
        """The offsets that join equally many children, with that number."""
        return [
            (size, [offset for offset in range(OFFSETS) if self.sizes[offset] == size])
            for size in sorted(set(self.sizes))
        ]

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """The offsets (27,), group after group."""
        return np.concatenate([offsets for _, offsets in self.groups])

    @cached_property
    def kernel_of_pair(self) -> NDArray[np.int64]:
        """Number of the kernel matrix of each pair of children, by offset, then by child read."""
        return np.concatenate([kernels.ravel() for kernels in self.kernels])

    @property
    def max_read(self) -> int:
        """Children that a row reads when it has every neighbour."""
        return sum(self.sizes) - self.children

    @property
    def typical_read(self) -> int:
        """Children that a row of a surface reads: it has about nine neighbours in a plane."""
        return most // 2 if (most := self.max_read) else 1


@cache
def voxel_kernel_map() -> KernelMap:
    """The kernel map where a row is one voxel."""
    zeros = np.zeros((OFFSETS, 8), dtype=np.int64)
    kernels = tuple(np.array([[offset]]) for offset in range(OFFSETS))
    return KernelMap(1, np.ones(OFFSETS, dtype=np.int64), zeros, zeros, kernels)


@cache
def block_kernel_map() -> KernelMap:
    """The kernel map where a row is eight children, numbered ``x + 2 y + 4 z``."""
    read, written = np.zeros((2, OFFSETS, 8), dtype=np.int64)
    counts, kernels = np.zeros(OFFSETS, dtype=np.int64), []
    for offset in range(OFFSETS):
        steps = [offset // 3**axis % 3 - 1 for axis in range(3)]
        near = _children([{-1: 1, 0: None, 1: 0}[step] for step in steps])
        own = _children([{-1: 0, 0: None, 1: 1}[step] for step in steps])
        counts[offset] = len(own)
        read[offset, : len(near)], written[offset, : len(own)] = near, own
        kernels.append(_kernel_between(near[:, None], own[None, :], steps))
    return KernelMap(8, counts, read, written, tuple(kernels))


def _children(corner: list[int | None]) -> NDArray[np.int64]:
    """Children with the given coordinates in the block; None stands for both."""
    every = np.arange(8)
    fits = [np.ones(8, bool) if at is None else (every >> axis & 1) == at
            for axis, at in enumerate(corner)]  # fmt: skip
    return every[np.logical_and.reduce(fits)]


def _kernel_between(
    near: NDArray[np.int64], own: NDArray[np.int64], steps: list[int]
) -> NDArray[np.int64]:
    parts = [
        (2 * step + (near >> axis & 1) - (own >> axis & 1) + 1) * 3**axis
        for axis, step in enumerate(steps)
    ]
    return np.asarray(sum(parts))

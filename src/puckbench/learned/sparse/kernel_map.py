"""Kernel maps of a sparse 3x3x3 convolution: the kernel matrix of each pair of voxels.

There are two memory layouts. *Voxels*: a row is one voxel. *Blocks*: a row is a parent's eight
children. An offset between parents connects 8 children of one parent (zero offset), 4 (across a
face), 2 (edge) or 1 (corner) with as many of the other, in 27 larger matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from puckbench.learned.sparse.voxels import OFFSETS


@dataclass(frozen=True)
class KernelMap:
    """The children that are read and written at each of the 27 offsets between rows."""

    children: int  # of a row: 1 (voxels) or 8 (blocks)
    counts: NDArray[np.int64]  # (27,), number of children read, and of children written
    read: NDArray[np.int64]  # (27, 8), children read; the first `counts` are in use
    written: NDArray[np.int64]  # (27, 8), children written
    # for each offset (count, count): kernel matrix from each child read to each child written
    kernels: tuple[NDArray[np.int64], ...]

    @cached_property
    def sizes(self) -> list[int]:
        sizes: list[int] = self.counts.tolist()
        return sizes

    @cached_property
    def groups(self) -> list[tuple[int, list[int]]]:
        return [
            (size, [offset for offset in range(OFFSETS) if self.sizes[offset] == size])
            for size in sorted(set(self.sizes))
        ]

    @cached_property
    def order(self) -> NDArray[np.int64]:
        return np.concatenate([offsets for _, offsets in self.groups])

    @cached_property
    def kernel_of_pair(self) -> NDArray[np.int64]:
        return np.concatenate([kernels.ravel() for kernels in self.kernels])

    @property
    def max_read(self) -> int:
        return sum(self.sizes) - self.children

    @property
    def typical_read(self) -> int:
        return self.max_read // 2 or 1  # on a surface a row has about nine neighbours


@cache
def voxel_kernel_map() -> KernelMap:
    zeros = np.zeros((OFFSETS, 8), dtype=np.int64)
    kernels = tuple(np.array([[offset]]) for offset in range(OFFSETS))
    return KernelMap(1, np.ones(OFFSETS, dtype=np.int64), zeros, zeros, kernels)


@cache
def block_kernel_map() -> KernelMap:
    read, written = np.zeros((2, OFFSETS, 8), dtype=np.int64)
    counts, kernels = np.zeros(OFFSETS, dtype=np.int64), []
    for offset in range(OFFSETS):
        steps = [offset // 3**axis % 3 - 1 for axis in range(3)]
        read_children = _children([{-1: 1, 0: None, 1: 0}[step] for step in steps])
        written_children = _children([{-1: 0, 0: None, 1: 1}[step] for step in steps])
        counts[offset] = len(written_children)
        read[offset, : len(read_children)], written[offset, : len(written_children)] = (
            read_children,
            written_children,
        )
        kernels.append(_kernel_between(read_children[:, None], written_children[None, :], steps))
    return KernelMap(8, counts, read, written, tuple(kernels))


def _children(corner: list[int | None]) -> NDArray[np.int64]:
    children = np.arange(8)
    fits = [np.ones(8, bool) if at is None else (children >> axis & 1) == at
            for axis, at in enumerate(corner)]  # fmt: skip
    return children[np.logical_and.reduce(fits)]


def _kernel_between(
    read_children: NDArray[np.int64], written_children: NDArray[np.int64], steps: list[int]
) -> NDArray[np.int64]:
    parts = [
        (2 * step + (read_children >> axis & 1) - (written_children >> axis & 1) + 1) * 3**axis
        for axis, step in enumerate(steps)
    ]
    return np.asarray(sum(parts))

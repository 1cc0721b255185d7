"""Kernel maps of a sparse 3x3x3 convolution: the kernel matrix of each pair of voxels.

There are two memory layouts. *Voxels*: a row is one voxel. *Blocks*: a row is a parent's eight
children, for 27 larger matrix products. An offset between two parents connects 8 children of one
parent (zero offset), 4 (across a face), 2 (edge) or 1 (corner) with as many of the other parent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from pcc_networks.sparse.voxels import OFFSETS


@dataclass(frozen=True)
class KernelMap:
    """The children that are read and written at each of the 27 offsets between rows."""

    children: int  # of a row: 1 (voxels) or 8 (blocks)
    counts: NDArray[np.int64]  # (27,), number of children read, and of children written
    read: NDArray[np.int64]  # (27, 8), children read; the first `counts` are in use
    written: NDArray[np.int64]  # (27, 8), children written
    # number of the kernel matrix from each child read to each child written, offset by offset
    kernel_of_pair: NDArray[np.int64]

    @cached_property
    def sizes(self) -> list[int]:
        sizes: list[int] = self.counts.tolist()
        return sizes

    @property
    def typical_read(self) -> int:
        # on a surface a row has about nine neighbours, half of all features that it could read
        return (sum(self.sizes) - self.children) // 2 or 1


@cache
def voxel_kernel_map() -> KernelMap:
    children = np.zeros((OFFSETS, 8), dtype=np.int64)
    return KernelMap(1, np.ones(OFFSETS, np.int64), children, children, np.arange(OFFSETS))


@cache
def block_kernel_map() -> KernelMap:
    read, written = np.zeros((2, OFFSETS, 8), dtype=np.int64)
    counts, kernels = np.zeros(OFFSETS, dtype=np.int64), []
    positions = np.arange(8)[:, None] >> np.arange(3) & 1
    for offset in range(OFFSETS):
        steps = offset // 3 ** np.arange(3) % 3 - 1
        is_read = ((steps == 0) | (positions == (steps < 0))).all(axis=1)
        sources = np.flatnonzero(is_read)
        targets = sources ^ (steps != 0) @ (1, 2, 4)  # on the other side of the common face
        count = counts[offset] = len(sources)
        read[offset, :count], written[offset, :count] = sources, targets
        distances = 2 * steps + positions[sources][:, None] - positions[targets]
        kernels.append((distances + 1) @ (1, 3, 9))
    return KernelMap(8, counts, read, written, np.concatenate([*map(np.ravel, kernels)]))

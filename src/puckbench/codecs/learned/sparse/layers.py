"""Layers between scales, and the sparse convolution as a module with parameters of its own."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from puckbench.codecs.learned.sparse.convolution import Site, convolve
from puckbench.codecs.learned.sparse.voxels import CHILDREN, OFFSETS, Families


class Weighted(nn.Module):
    """A kernel (offsets, c, d), x fastest among the offsets, and a bias (d)."""

    def __init__(self, offsets: int, width: int, wider: int) -> None:
        super().__init__()
        spread = 1 / math.sqrt(offsets * width)
        self.kernel = nn.Parameter(torch.empty(offsets, width, wider).uniform_(-spread, spread))
        self.bias = nn.Parameter(torch.zeros(wider))


class Convolution(Weighted):
    """3x3x3, from a set of voxels to itself."""

    def __init__(self, width: int, wider: int) -> None:
        super().__init__(OFFSETS, width, wider)

    def forward(self, features: Tensor, where: Site) -> Tensor:
        """(n, children, c) to (n, children, d)."""
        return convolve(features, self.kernel, self.bias, where)


class Pointwise(Weighted):
    """1x1x1: each voxel by itself."""

    def __init__(self, width: int, wider: int) -> None:
        super().__init__(1, width, wider)

    def forward(self, features: Tensor) -> Tensor:
        """(n, children, c) to (n, children, d)."""
        return features @ self.kernel[0] + self.bias


class Down(Weighted):
    """2x2x2 with stride 2, from a set to the next coarser one."""

    def __init__(self, width: int, wider: int) -> None:
        super().__init__(CHILDREN, width, wider)

    def forward(self, features: Tensor, families: Families) -> Tensor:
        """(n, 1, c) of the children to (m, 1, d) of their parents."""
        blocks = features.new_zeros(CHILDREN * (len(families.first) - 1), features.shape[2])
        slots = torch.from_numpy(families.slots).to(features.device)
        blocks = blocks.index_copy(0, slots, features[:, 0])
        sums = blocks.view(len(families.first) - 1, -1) @ self.kernel.flatten(0, 1) + self.bias
        return sums[:, None]


class Up(Weighted):
    """Transposed 2x2x2 with stride 2, from a set to all children of its voxels."""

    def __init__(self, width: int, wider: int) -> None:
        super().__init__(CHILDREN, width, wider)

    def matrix(self) -> Tensor:
        """(c, 8 d), all children of a parent at once."""
        return self.kernel.transpose(0, 1).flatten(1)

    def forward(self, features: Tensor) -> Tensor:
        """(m, c) to (m, 8, d)."""
        return (features @ self.matrix()).view(len(features), CHILDREN, -1) + self.bias


def largest(logits: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Rows of the `count` (1 or more) largest, ascending; of equal ones the first, by key."""
    if count >= len(logits):
        return np.arange(len(logits))
    least = np.partition(logits, len(logits) - count)[len(logits) - count]
    chosen = logits > least
    ties = np.flatnonzero(logits == least)
    chosen[ties[: count - np.count_nonzero(chosen)]] = True
    return np.flatnonzero(chosen)


def kept_children(
    logits: NDArray[np.float32], count: int, families: bool = True
) -> NDArray[np.int64]:
    """Slots, ascending, of the `count` children to keep by their logits (m, 8).

    families: every parent keeps its likeliest child; otherwise it may lose all of them.
    """
    return likeliest(logits, count) if families else largest(logits.reshape(-1), count)


def likeliest(logits: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Slots of `count` children by their logits (m, 8), ascending; every parent has one if it can.

    A voxel that is occupied has a child that is. Without this rule the likeliest children may all
    be of the same few parents, and the others leave holes.
    """
    best = logits.argmax(axis=1)
    rows = np.arange(len(logits))
    if count <= len(logits):
        chosen = largest(logits[rows, best], count)
        slots: NDArray[np.int64] = CHILDREN * chosen + best[chosen]
        return slots
    ranked = logits.copy()
    ranked[rows, best] = np.inf
    return largest(ranked.reshape(-1), count)

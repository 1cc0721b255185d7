from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pcc_networks.sparse.convolution import Neighbourhood, convolve
from pcc_networks.sparse.voxels import CHILDREN, OFFSETS, ChildMap


class SparseLayer(nn.Module):
    """A layer with a kernel (offsets, c, d), offsets with x fastest, and a bias (d,)."""

    offsets = OFFSETS

    def __init__(self, in_channels: int, out_channels: int, offsets: int | None = None) -> None:
        super().__init__()
        offsets = offsets or self.offsets
        spread = 1 / math.sqrt(offsets * in_channels)
        self.kernel = nn.Parameter(
            torch.empty(offsets, in_channels, out_channels).uniform_(-spread, spread)
        )
        self.bias = nn.Parameter(torch.zeros(out_channels))


class SparseConvolution(SparseLayer):
    """3x3x3 convolution of features (n, children, c) to (n, children, d) at the same voxels."""

    def forward(self, features: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        return convolve(features, self.kernel, self.bias, neighbourhood)


class PointwiseConvolution(SparseLayer):
    """1x1x1 convolution of features (n, children, c) to (n, children, d)."""

    offsets = 1

    def forward(self, features: Tensor) -> Tensor:
        return features @ self.kernel[0] + self.bias


class StridedConvolution(SparseLayer):
    """2x2x2 convolution with stride 2, from a set of voxels to the next coarser set."""

    offsets = CHILDREN

    def forward(self, features: Tensor, child_map: ChildMap) -> Tensor:
        blocks = features.new_zeros(CHILDREN * (len(child_map.first) - 1), features.shape[2])
        slots = torch.from_numpy(child_map.slots).to(features.device)
        blocks = blocks.index_copy(0, slots, features[:, 0])
        sums = blocks.view(len(child_map.first) - 1, -1) @ self.kernel.flatten(0, 1) + self.bias
        return sums[:, None]


class GenerativeTransposedConvolution(SparseLayer):
    """Transposed 2x2x2 convolution with stride 2, from voxels to all their children."""

    offsets = CHILDREN

    def matrix(self) -> Tensor:
        return self.kernel.transpose(0, 1).flatten(1)

    def forward(self, features: Tensor) -> Tensor:
        return (features @ self.matrix()).view(len(features), CHILDREN, -1) + self.bias


def top_k(logits: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Return the ascending indices of the `count` >= 1 largest logits; ties go to lower indices."""
    if count >= len(logits):
        return np.arange(len(logits))
    least = np.partition(logits, len(logits) - count)[len(logits) - count]
    selected = logits > least
    ties = np.flatnonzero(logits == least)
    selected[ties[: count - np.count_nonzero(selected)]] = True
    return np.flatnonzero(selected)


def kept_children(
    logits: NDArray[np.float32], count: int, child_per_parent: bool = True
) -> NDArray[np.int64]:
    """Return the ascending slots (8 * parent + child) of the `count` most likely children.

    The logits are (m, 8). With `child_per_parent`, each parent's most likely child has priority;
    otherwise a parent may lose all children.
    """
    if not child_per_parent:
        return top_k(logits.reshape(-1), count)
    best = logits.argmax(axis=1)
    rows = np.arange(len(logits))
    if count <= len(logits):
        selected = top_k(logits[rows, best], count)
        slots: NDArray[np.int64] = CHILDREN * selected + best[selected]
        return slots
    ranked = logits.copy()
    ranked[rows, best] = np.inf
    return top_k(ranked.reshape(-1), count)

"""The network: features of a level's voxels, from them their symbols, then their children's.

All levels share the weights. In the manner of You, Chen, Liu, Xu: "RENO: real-time neural
compression for 3D LiDAR point clouds", CVPR 2025, with features handed down from level to level,
and voxels in groups: a convolution before each group sees the symbols of the groups before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from puckbench.codecs.learned.octree_net.fixed_point import (
    MOST_SUM,
    activated,
    largest_sum,
    rounded,
    streamed,
    weight,
)
from puckbench.codecs.learned.octree_net.symbols import GROUPS, VALUES, Symbols
from puckbench.codecs.learned.sparse.convolution import Site, convolve
from puckbench.codecs.learned.sparse.layers import Weighted
from puckbench.codecs.learned.sparse.voxels import CHILDREN, OFFSETS
from puckbench.core.errors import InputError


@dataclass(frozen=True)
class Shape:
    """Sizes. width: of features. before: convolutions of a level before its first group."""

    width: int = 32
    before: int = 1


class Layer(Weighted):
    """A kernel (offsets, c, d) and a bias, of which only multiples of their units count."""

    def forward(self, read: Tensor, where: Site) -> Tensor:
        """A 3x3x3 convolution of activations (n, c)."""
        kernel, bias = weight(self.kernel), rounded(self.bias)
        return convolve(read[:, None], kernel, bias, where)[:, 0]

    def rows(self, read: Tensor) -> Tensor:
        """Each voxel's activations (n, c) by themselves."""
        return read @ weight(self.kernel[0]) + rounded(self.bias)


class Head(nn.Module):
    """Logits, to the base 2, of a symbol."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.hidden, self.logits = Layer(1, width, width), Layer(1, width, VALUES)

    def forward(self, features: Tensor) -> Tensor:
        """(n, width) to (n, 16), multiples of the unit."""
        hidden = streamed(self.hidden.rows(activated(features)))
        return streamed(self.logits.rows(activated(hidden)))


class OctreeNet(nn.Module):
    """Predicts levels one after the other; features are (n, width) in multiples of the unit."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        width = shape.width
        self.top = nn.Parameter(torch.ones(width))
        self.before = nn.ModuleList(Layer(OFFSETS, width, width) for _ in range(shape.before))
        self.between = nn.ModuleList(Layer(OFFSETS, width, width) for _ in range(GROUPS - 1))
        self.first_heads = nn.ModuleList(Head(width) for _ in range(GROUPS))
        self.second_heads = nn.ModuleList(Head(width) for _ in range(GROUPS))
        self.first_known = nn.Parameter(torch.randn(VALUES, width) / 4)
        self.second_known = nn.Parameter(torch.randn(VALUES, width) / 4)
        self.down = Layer(CHILDREN, width, width)

    def start(self, count: int) -> Tensor:
        """Features of the voxels of the top level."""
        return rounded(self.top).repeat(count, 1)

    def before_groups(self, features: Tensor, where: Site) -> Tensor:
        """Features of a level's voxels before anything of their children is known."""
        for layer in self.before:
            features = streamed(features + layer(activated(features), where))
        return features

    def of_group(self, group: int, features: Tensor, rows: Tensor, where: Site) -> Tensor:
        """Features of the `rows` of a group, from those of all voxels."""
        if group == 0:
            return features[rows]
        made = self.between[group - 1](activated(features), where)
        return streamed((features + made)[rows])

    def with_first(self, features: Tensor, first: Tensor) -> Tensor:
        """Features that know the first symbols, (n,) int64."""
        return streamed(features + rounded(self.first_known)[first])

    def with_second(self, features: Tensor, second: Tensor) -> Tensor:
        """Features that know the second symbols too."""
        return streamed(features + rounded(self.second_known)[second])

    def below(self, features: Tensor, slots: Tensor) -> Tensor:
        """Features of the children at `slots`, from those of their parents."""
        read = activated(features)
        kernel, bias = weight(self.down.kernel), rounded(self.down.bias)
        parent, child = slots >> 3, slots & 7
        order = [torch.nonzero(child == c)[:, 0] for c in range(CHILDREN)]
        made = torch.cat([read[parent[rows]] @ kernel[c] for c, rows in enumerate(order)])
        result = torch.empty_like(made).index_copy(0, torch.cat(order), made)
        return streamed(result + bias)

    def check(self) -> None:
        """InputError when weights are so large that sums might not be exact."""
        layers = [module for module in self.modules() if isinstance(module, Layer)]
        for layer in layers:
            kernel, bias = weight(layer.kernel), rounded(layer.bias)
            if largest_sum(kernel, bias) >= MOST_SUM:
                raise InputError("the weights are too large for exact sums")


def index(symbols: Symbols | NDArray[Any], like: Tensor) -> Tensor:
    """Integers as PyTorch indexes with, on the device of a tensor."""
    return torch.from_numpy(symbols.astype("int64")).to(like.device)

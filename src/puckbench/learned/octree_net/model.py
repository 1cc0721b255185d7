"""The network of the learned octree coder: features of voxels, their symbols, their children.

All levels of the octree share the weights. Features are handed down from level to level, and the
voxels of a level are coded in groups: a convolution before each group sees the symbols of the
groups before it.

References
----------
You, Chen, Ding, Asif, Ma: "RENO: real-time neural compression for 3D LiDAR point clouds", CVPR
2025, in whose manner a small sparse network predicts occupancy level by level.
"""

from __future__ import annotations

from typing import Annotated, Any

import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor, nn

from puckbench.core.errors import InputError
from puckbench.core.models import Model
from puckbench.learned.octree_net.fixed_point import (
    MAX_SUM,
    activation,
    largest_sum,
    quantised,
    quantised_weight,
    residual,
)
from puckbench.learned.octree_net.symbols import GROUPS, VALUES, Symbols
from puckbench.learned.sparse.convolution import Neighbourhood, convolve
from puckbench.learned.sparse.layers import SparseLayer
from puckbench.learned.sparse.voxels import CHILDREN, OFFSETS


class OctreeNetShape(Model):
    """Sizes of the network.

    Parameters
    ----------
    channels
        Of the features.
    convolutions
        Convolutions of a level before its first group.
    """

    channels: Annotated[int, Field(ge=1, le=256)] = 32
    convolutions: Annotated[int, Field(ge=0, le=8)] = 1


class FixedPointLayer(SparseLayer):
    """A fixed-point layer: its kernel (offsets, c, d) and bias are rounded when they are used."""

    def forward(self, active: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        """A 3x3x3 convolution of activations (n, c) to (n, d)."""
        kernel, bias = quantised_weight(self.kernel), quantised(self.bias)
        return convolve(active[:, None], kernel, bias, neighbourhood)[:, 0]

    def pointwise(self, active: Tensor) -> Tensor:
        """A 1x1x1 convolution of activations (n, c) to (n, d)."""
        return active @ quantised_weight(self.kernel[0]) + quantised(self.bias)


class SymbolHead(nn.Module):
    """Two pointwise layers from features to logits, to the base 2, of a symbol."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.hidden, self.logits = (
            FixedPointLayer(1, channels, channels),
            FixedPointLayer(1, channels, VALUES),
        )

    def forward(self, features: Tensor) -> Tensor:
        """Features (n, channels) to logits (n, 16), multiples of the unit."""
        hidden = residual(self.hidden.pointwise(activation(features)))
        return residual(self.logits.pointwise(activation(hidden)))


class OctreeNet(nn.Module):
    """Predicts one level after the other; features are (n, channels), multiples of the unit."""

    def __init__(self, shape: OctreeNetShape) -> None:
        super().__init__()
        self.shape = shape
        channels = shape.channels
        self.root = nn.Parameter(torch.ones(channels))
        self.convolutions = _convolutions(shape.convolutions, channels)
        self.group_convolutions = _convolutions(GROUPS - 1, channels)
        self.first_heads = nn.ModuleList(SymbolHead(channels) for _ in range(GROUPS))
        self.second_heads = nn.ModuleList(SymbolHead(channels) for _ in range(GROUPS))
        self.first_embedding = nn.Parameter(torch.randn(VALUES, channels) / 4)
        self.second_embedding = nn.Parameter(torch.randn(VALUES, channels) / 4)
        self.upsampling = FixedPointLayer(CHILDREN, channels, channels)

    def root_features(self, count: int) -> Tensor:
        """Features of the voxels of the top level."""
        return quantised(self.root).repeat(count, 1)

    def convolved(self, features: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        """Features of a level's voxels before any of their children are known."""
        for layer in self.convolutions:
            features = residual(features + layer(activation(features), neighbourhood))
        return features

    def group_features(
        self, group: int, features: Tensor, rows: Tensor, neighbourhood: Neighbourhood
    ) -> Tensor:
        """Features of the rows of a group, from those of all voxels of the level."""
        if group == 0:
            return features[rows]
        made = self.group_convolutions[group - 1](activation(features), neighbourhood)
        return residual((features + made)[rows])

    def with_first(self, features: Tensor, first: Tensor) -> Tensor:
        """Features (n, channels) with the embedding of the first symbols (n,) int64 added."""
        return residual(features + quantised(self.first_embedding)[first])

    def with_second(self, features: Tensor, second: Tensor) -> Tensor:
        """Features (n, channels) with the embedding of the second symbols (n,) int64 added."""
        return residual(features + quantised(self.second_embedding)[second])

    def child_features(self, features: Tensor, slots: Tensor) -> Tensor:
        """Features of the children in slots ``8 * parent + child``, from those of their parents."""
        active = activation(features)
        kernel, bias = quantised_weight(self.upsampling.kernel), quantised(self.upsampling.bias)
        parent, child = slots >> 3, slots & 7
        order = [torch.nonzero(child == c)[:, 0] for c in range(CHILDREN)]
        made = torch.cat([active[parent[rows]] @ kernel[c] for c, rows in enumerate(order)])
        result = torch.empty_like(made).index_copy(0, torch.cat(order), made)
        return residual(result + bias)

    def check_exact(self) -> None:
        """Raise InputError if weights are so large that sums might not be exact."""
        layers = [module for module in self.modules() if isinstance(module, FixedPointLayer)]
        for layer in layers:
            kernel, bias = quantised_weight(layer.kernel), quantised(layer.bias)
            if largest_sum(kernel, bias) >= MAX_SUM:
                raise InputError("the weights are too large for exact sums")


def _convolutions(count: int, channels: int) -> nn.ModuleList:
    return nn.ModuleList(FixedPointLayer(OFFSETS, channels, channels) for _ in range(count))


def as_index(symbols: Symbols | NDArray[Any], like: Tensor) -> Tensor:
    """Integers (n,) as an index tensor on the device of another tensor."""
    return torch.from_numpy(symbols.astype("int64")).to(like.device)

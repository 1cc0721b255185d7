"""The sparse octree net, which predicts which children of each voxel are occupied.

It proceeds level by level, from the coarsest voxels to the finest. All levels share the weights.
The features of children are computed from those of their parents. The occupancy of a voxel is coded
as two symbols (see `symbols`). The voxels of a level are coded in groups; before each group, a
convolution uses the symbols of the previous groups.

The arithmetic is fixed-point, which floating-point hardware computes exactly: weights are multiples
of 2**-9, activations of 2**-5. The sums of a layer, in units of 2**-14, are below 2**24. Single
precision computes such sums exactly, in any order, on any processor.

References
----------
Ballé et al.: "Integer Networks for Data Compression with Latent-Variable Models", ICLR 2019.
"""

from __future__ import annotations

from typing import Annotated, Any

import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor, nn

from pcc_networks.octree_net.symbols import GROUPS, VALUES, Symbols
from pcc_networks.sparse.convolution import Neighbourhood, SparseLayer, convolve
from pcc_networks.sparse.voxels import CHILDREN
from pointkit.errors import InputError
from pointkit.models import Model

WEIGHT_UNITS = 2**9
UNITS = 2**5
"""Activations, features between layers, and logits are multiples of 1 / UNITS."""
MAX_WEIGHT = 2**11 - 1
"""Maximum weight in units of 1 / WEIGHT_UNITS; half precision stores such weights exactly."""
MAX_ACTIVATION = 255
MAX_RESIDUAL = 2**11
MAX_SUM = 2**24


class _StraightThrough(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, units: int) -> Tensor:
        return (values * units).round_().div_(units)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return gradient, None


def quantised(values: Tensor, units: int = UNITS) -> Tensor:
    """Round values to multiples of 1 / units, ties to even; gradients pass unchanged."""
    result: Tensor = _StraightThrough.apply(values, units)  # type: ignore[no-untyped-call]
    return result


def quantised_weight(values: Tensor) -> Tensor:
    """Clip weights to the allowed range, and round them to multiples of 1 / WEIGHT_UNITS."""
    bound = MAX_WEIGHT / WEIGHT_UNITS
    return quantised(values.clamp(-bound, bound), WEIGHT_UNITS)


def residual(values: Tensor) -> Tensor:
    """Clip and round sums to features, which are multiples of 1 / UNITS."""
    bound = MAX_RESIDUAL / UNITS
    return quantised(values.clamp(-bound, bound))


def activation(values: Tensor) -> Tensor:
    """Apply the clipped ReLU to the features that a layer reads."""
    return values.clamp(0, MAX_ACTIVATION / UNITS)


def largest_sum(kernel: Tensor, bias: Tensor) -> int:
    """Return a bound of the sums that a layer can produce, in units of 2**-14."""
    rows = kernel.detach().double().flatten(0, -2).abs().sum(dim=0) * WEIGHT_UNITS
    bound = rows * MAX_ACTIVATION + bias.detach().double().abs() * (WEIGHT_UNITS * UNITS)
    return int(bound.max()) + MAX_RESIDUAL * WEIGHT_UNITS


class OctreeNetShape(Model):
    """Sizes of the sparse octree net, by default those of the set that comes with the package."""

    channels: Annotated[int, Field(ge=1, le=256)] = 32
    convolutions: Annotated[int, Field(ge=0, le=8)] = 1  # of a level before its first group


class FixedPointLayer(SparseLayer):
    """A sparse 3x3x3 or pointwise convolution in fixed-point arithmetic."""

    def forward(self, active: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        kernel, bias = quantised_weight(self.kernel), quantised(self.bias)
        return convolve(active[:, None], kernel, bias, neighbourhood)[:, 0]

    def pointwise(self, active: Tensor) -> Tensor:
        """Apply the layer as a pointwise convolution."""
        return active @ quantised_weight(self.kernel[0]) + quantised(self.bias)


class SymbolHead(nn.Module):
    """Computes the base-2 logits of a symbol from features, by two pointwise layers."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.hidden = FixedPointLayer(channels, channels, 1)
        self.logits = FixedPointLayer(channels, VALUES, 1)

    def forward(self, features: Tensor) -> Tensor:
        """Return the logits (n, 16) of a symbol from features (n, channels)."""
        hidden = residual(self.hidden.pointwise(activation(features)))
        return residual(self.logits.pointwise(activation(hidden)))


class OctreeNet(nn.Module):
    """The sparse octree net, a PyTorch module in fixed-point arithmetic.

    It predicts which of the eight children of each voxel are occupied, level by level from the
    coarsest. Features have the shape (n, channels), with a row for each voxel of a level.
    """

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
        self.upsampling = FixedPointLayer(channels, channels, CHILDREN)

    def root_features(self, count: int) -> Tensor:
        """Return the features (count, channels) of the voxels of the top level."""
        return quantised(self.root).repeat(count, 1)

    def convolved(self, features: Tensor, neighbourhood: Neighbourhood) -> Tensor:
        """Apply the convolutions that precede the first group of a level."""
        for layer in self.convolutions:
            features = residual(features + layer(activation(features), neighbourhood))
        return features

    def group_features(
        self, group: int, features: Tensor, rows: Tensor, neighbourhood: Neighbourhood
    ) -> Tensor:
        """Return the features of the voxels of a group.

        Parameters
        ----------
        group
            Index of the group.
        features
            Features (n, channels) of all voxels of the level.
        rows
            Rows (m,) of the voxels of the group.
        neighbourhood
            Neighbours of all voxels of the level.
        """
        if group == 0:
            return features[rows]
        convolved = self.group_convolutions[group - 1](activation(features), neighbourhood)
        return residual((features + convolved)[rows])

    def with_first(self, features: Tensor, first: Tensor) -> Tensor:
        """Return features to which first symbols have been added, to predict second symbols."""
        return residual(features + quantised(self.first_embedding)[first])

    def with_second(self, features: Tensor, second: Tensor) -> Tensor:
        """Return features to which second symbols have been added, for later groups."""
        return residual(features + quantised(self.second_embedding)[second])

    def child_features(self, features: Tensor, slots: Tensor) -> Tensor:
        """Return the features of children from those of their parents.

        Parameters
        ----------
        features
            Features (n, channels) of the parents.
        slots
            For each child (m,), 8 times the row of the parent plus the number of the child.
        """
        active = activation(features)
        kernel, bias = quantised_weight(self.upsampling.kernel), quantised(self.upsampling.bias)
        parent, child = slots >> 3, slots & 7
        order = [torch.nonzero(child == c)[:, 0] for c in range(CHILDREN)]
        products = torch.cat([active[parent[rows]] @ kernel[c] for c, rows in enumerate(order)])
        result = torch.empty_like(products).index_copy(0, torch.cat(order), products)
        return residual(result + bias)

    def check_exact(self) -> None:
        """Raise InputError if the weights are so large that sums might be inexact."""
        layers = [module for module in self.modules() if isinstance(module, FixedPointLayer)]
        for layer in layers:
            kernel, bias = quantised_weight(layer.kernel), quantised(layer.bias)
            if largest_sum(kernel, bias) >= MAX_SUM:
                raise InputError("the weights are too large for exact sums")


def _convolutions(count: int, channels: int) -> nn.ModuleList:
    return nn.ModuleList(FixedPointLayer(channels, channels) for _ in range(count))


def as_index(symbols: Symbols | NDArray[Any], like: Tensor) -> Tensor:
    """Convert an array to a tensor of 64-bit integers on the device of another tensor."""
    return torch.from_numpy(symbols.astype("int64")).to(like.device)

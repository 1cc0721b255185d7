"""The hyper-synthesis transform h_s in integers, with equal results on every machine.

Weights are rounded to multiples of 2**-16, features of 2**-12; products and sums are integers below
2**53, exact in double precision (see the reference of `octree_net.fixed_point`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import conv3d, conv_transpose3d

from pcc_networks.pcgcv1.laplace import UNITS, TableIndexes, build_indexes
from pcc_networks.pcgcv1.model import HyperSynthesis
from pointkit.errors import InputError

_WEIGHT_UNITS = 2**16
_MAX_FEATURE = 2**11
"""Bound of features; those of the authors' networks stay below a hundred."""


@dataclass(frozen=True)
class _Layer:
    kernel: Tensor
    bias: Tensor


class IntegerHyperSynthesis:
    """Chooses a latent's frequency tables; raises InputError if sums might be inexact."""

    def __init__(self, network: HyperSynthesis) -> None:
        self.conv1, self.conv2 = _layer(network.conv1), _layer(network.conv2)
        self.conv3 = _layer(network.conv3)
        heads = (_layer(network.location), _layer(network.scale))
        self.heads = _Layer(
            torch.cat([head.kernel for head in heads]), torch.cat([head.bias for head in heads])
        )

    def tables(self, z_hat: NDArray[np.int32]) -> TableIndexes:
        """Return table indexes of y (channels, 2 s, 2 s, 2 s) from z_hat (channels, s, s, s)."""
        with torch.no_grad():
            features = (
                torch.from_numpy(z_hat)[None].double().clamp(-_MAX_FEATURE, _MAX_FEATURE) * UNITS
            )
            features = _requantised(_conv(features, self.conv1)).relu()
            features = _requantised(_transposed_conv(features, self.conv2)).relu()
            features = _requantised(_conv(features, self.conv3)).relu()
            heads = _requantised(_conv(features, self.heads))[0].numpy().astype(np.int64)
        location, scale = np.split(heads, 2)
        return build_indexes(location, np.abs(scale))


def _layer(layer: torch.nn.Conv3d | torch.nn.ConvTranspose3d) -> _Layer:
    kernel = (layer.weight.detach().double() * _WEIGHT_UNITS).round()
    bias = (cast(Tensor, layer.bias).detach().double() * (_WEIGHT_UNITS * UNITS)).round()
    axes = (0, 2, 3, 4) if isinstance(layer, torch.nn.ConvTranspose3d) else (1, 2, 3, 4)
    largest = kernel.abs().sum(axes).max() * (_MAX_FEATURE * UNITS) + bias.abs().max()
    if not largest < 2**53:
        raise InputError("the z_hat-decoder's weights are too large for exact sums")
    return _Layer(kernel, bias)


def _conv(features: Tensor, layer: _Layer) -> Tensor:
    return conv3d(features, layer.kernel, layer.bias, padding=1)


def _transposed_conv(features: Tensor, layer: _Layer) -> Tensor:
    full = conv_transpose3d(features, layer.kernel, layer.bias, stride=2)
    return full[:, :, :-1, :-1, :-1]


def _requantised(sums: Tensor) -> Tensor:
    return (sums / _WEIGHT_UNITS).round_().clamp_(-_MAX_FEATURE * UNITS, _MAX_FEATURE * UNITS)

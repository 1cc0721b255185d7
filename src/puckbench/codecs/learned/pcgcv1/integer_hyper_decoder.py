"""The hyper-decoder in whole numbers: the same on every machine, whatever the order of its sums.

Weights are rounded to 2**-16 and what passes between layers to 2**-12. Products and sums are then
whole numbers below 2**53, which double precision holds exactly, so that neither threads nor a fused
multiplication nor another library can change one bit: encoder and decoder always choose the same
tables. (An "integer network" in the sense of Ballé, Johnston, Minnen, ICLR 2019.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import conv3d, conv_transpose3d

from puckbench.codecs.learned.pcgcv1.laplace import UNITS, Chosen, choose
from puckbench.codecs.learned.pcgcv1.model import HyperDecoder
from puckbench.core.errors import InputError

_WEIGHT_UNITS = 2**16
_MOST = 2**11
"""Features are clipped to so much; the originals' stay below a hundred."""


@dataclass(frozen=True)
class _Layer:
    """Whole numbers in double precision: kernel and bias in their units."""

    kernel: Tensor
    bias: Tensor


class ExactHyperDecoder:
    """Chooses the tables of the latent of one cube after the other.

    InputError when weights are so large that sums would not be exact.
    """

    def __init__(self, network: HyperDecoder) -> None:
        self.first, self.wide = _layer(network.first), _layer(network.wide)
        self.up = _layer(network.up)
        heads = (_layer(network.location), _layer(network.scale))
        self.heads = _Layer(
            torch.cat([head.kernel for head in heads]), torch.cat([head.bias for head in heads])
        )

    def tables(self, hyper: NDArray[np.int32]) -> Chosen:
        """Hyper-latent (hyper, s, s, s) to the tables of the latent, (latent, 2 s, 2 s, 2 s)."""
        with torch.no_grad():
            features = torch.from_numpy(hyper)[None].double().clamp(-_MOST, _MOST) * UNITS
            features = _between(_same(features, self.first)).relu()
            features = _between(_raised(features, self.up)).relu()
            features = _between(_same(features, self.wide)).relu()
            heads = _between(_same(features, self.heads))[0].numpy().astype(np.int64)
        location, scale = np.split(heads, 2)
        return choose(location, np.abs(scale))


def _layer(layer: torch.nn.Conv3d | torch.nn.ConvTranspose3d) -> _Layer:
    kernel = (layer.weight.detach().double() * _WEIGHT_UNITS).round()
    bias = (cast(Tensor, layer.bias).detach().double() * (_WEIGHT_UNITS * UNITS)).round()
    axes = (0, 2, 3, 4) if isinstance(layer, torch.nn.ConvTranspose3d) else (1, 2, 3, 4)
    largest = kernel.abs().sum(axes).max() * (_MOST * UNITS) + bias.abs().max()
    if not largest < 2**53:
        raise InputError("the hyper-decoder's weights are too large for exact sums")
    return _Layer(kernel, bias)


def _same(features: Tensor, layer: _Layer) -> Tensor:
    return conv3d(features, layer.kernel, layer.bias, padding=1)


def _raised(features: Tensor, layer: _Layer) -> Tensor:
    whole = conv_transpose3d(features, layer.kernel, layer.bias, stride=2)
    return whole[:, :, :-1, :-1, :-1]


def _between(sums: Tensor) -> Tensor:
    """Sums in units of both factors, rounded to the units that pass between layers."""
    return (sums / _WEIGHT_UNITS).round_().clamp_(-_MOST * UNITS, _MOST * UNITS)

"""Computation of the latent's distributions from the hyper-latent, equal on all machines.

The hyper-synthesis transform h_s is computed in integers. Weights are rounded to multiples of
2**-16, features to multiples of 2**-12. Products and sums are integers below 2**53, which double
precision computes exactly (see the reference of `octree_net.model`). The transform gives the
location and the scale of each latent value in units of 2**-12. These select one of 1,024 integer
tables of Laplace distributions, with 16 offsets between two integers and 64 scales. The tables are
equal on every machine, since they are computed from a correctly rounded exponential by
multiplications.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import conv3d, conv_transpose3d

from pcc_networks.entropy_bottleneck import LIKELIHOOD_BOUND, FrequencyTable
from pcc_networks.pcgcv1.cubes import rows_of
from pcc_networks.pcgcv1.model import HyperSynthesis
from pointkit.errors import InputError

UNIT_BITS = 12
UNITS = 2**UNIT_BITS
OFFSET_BITS = 4
OFFSETS = 2**OFFSET_BITS
SCALES = 64
MIN_SCALE, MAX_SCALE = 2.0**-5, 2.0**5
_TOTAL_BITS = 22
_ESCAPE_FREQUENCY = 4
"""Frequency of all values outside a table, 2**-20 of the total."""
_TAIL_SCALES = 13.9
"""20 ln 2, the distance in scales beyond which a Laplace distribution has a mass of 2**-20."""

Int64s = NDArray[np.int64]


class TableIndexes(NamedTuple):
    """The frequency table of each latent value, and the integer on which the table is centred."""

    table: NDArray[np.uint16]  # number of the table
    centre: NDArray[np.int32]  # integer on which the table is centred

    def rows(self, blocks: NDArray[np.bool_]) -> TableIndexes:
        """Return the indexes (n, channels) at true blocks (m, s, s, s)."""
        return TableIndexes(rows_of(self.table, blocks), rows_of(self.centre, blocks))


Join = Callable[[Sequence[NDArray[Any]]], NDArray[Any]]


def joined(join: Join, parts: Sequence[TableIndexes]) -> TableIndexes:
    """Join table indexes by a function that joins arrays, such as `numpy.concatenate`."""
    return TableIndexes(*map(join, zip(*parts, strict=True)))


def build_indexes(location: Int64s, scale: Int64s) -> TableIndexes:
    """Return the table indexes for locations and scales in units of 2**-12."""
    step = UNIT_BITS - OFFSET_BITS
    offset = (location + (1 << step - 1)) >> step
    level = np.searchsorted(_scale_borders(), scale)
    table = level << OFFSET_BITS | offset & (OFFSETS - 1)
    return TableIndexes(table.astype(np.uint16), (offset >> OFFSET_BITS).astype(np.int32))


def _scale(level: Decimal) -> Decimal:
    low, high = Decimal(MIN_SCALE), Decimal(MAX_SCALE)
    return low * ((high / low).ln(_CONTEXT) * level / (SCALES - 1)).exp(_CONTEXT)


_CONTEXT = Context(prec=40)
"""Unlike C libraries, `decimal` rounds exponentials correctly."""


@cache
def _scale_borders() -> Int64s:
    halves = (Decimal(level) + Decimal("0.5") for level in range(SCALES - 1))
    return np.array([int((_scale(half) * UNITS).to_integral_value()) for half in halves])


@cache
def laplace_table(number: int) -> FrequencyTable:
    """Return the frequency table with this number, whose integers are relative to its centre."""
    level, offset = number >> OFFSET_BITS, number & (OFFSETS - 1)
    scale = float(_scale(Decimal(level)))
    reach = int(scale * _TAIL_SCALES) + 1
    # edges of the integers' unit intervals, as distances from the location in 1 / OFFSETS
    edges = np.arange(-reach, reach + 3) * OFFSETS - OFFSETS // 2 - offset
    tail = _powers(level, np.abs(edges).max())[np.abs(edges)] / 2
    below = np.where(edges < 0, tail, 1 - tail)
    masses = np.rint(np.diff(below) * 2**_TOTAL_BITS).astype(np.int32)
    return FrequencyTable(
        -reach, np.append(np.maximum(masses, 1), _ESCAPE_FREQUENCY).astype(np.int32)
    )


def _powers(level: int, max_exponent: int) -> NDArray[np.float64]:
    ratio = float((-1 / (OFFSETS * _scale(Decimal(level)))).exp(_CONTEXT))
    return np.cumprod(np.append(1.0, np.full(max_exponent, ratio)))


def likelihood(latent: Tensor, location: Tensor, scale: Tensor) -> Tensor:
    """Return the Laplace probability of the unit interval around each value, for training."""
    scale = scale.clamp_min(MIN_SCALE)
    distance = (latent - location).abs()
    mass = _cumulative(0.5 - distance, scale) - _cumulative(-0.5 - distance, scale)
    return mass.clamp_min(LIKELIHOOD_BOUND)


def _cumulative(values: Tensor, scale: Tensor) -> Tensor:
    tail = (-values.abs() / scale).exp() / 2
    return torch.where(values < 0, tail, 1 - tail)


_WEIGHT_UNITS = 2**16
_MAX_FEATURE = 2**11
"""Bound of features; those of the authors' networks stay below a hundred."""


@dataclass(frozen=True)
class _Layer:
    kernel: Tensor
    bias: Tensor


class IntegerHyperSynthesis:
    """The hyper-synthesis transform h_s in integer arithmetic, which selects frequency tables.

    Raises InputError if the weights are so large that sums might be inexact.
    """

    def __init__(self, network: HyperSynthesis) -> None:
        self.conv1, self.conv2 = _layer(network.conv1), _layer(network.conv2)
        self.conv3 = _layer(network.conv3)
        heads = (_layer(network.location), _layer(network.scale))
        self.heads = _Layer(
            torch.cat([head.kernel for head in heads]), torch.cat([head.bias for head in heads])
        )

    def tables(self, z_hat: NDArray[np.int32]) -> TableIndexes:
        """Return the frequency tables of the latent of a cube.

        Parameters
        ----------
        z_hat
            Hyper-latent (channels, s, s, s).

        Returns
        -------
        TableIndexes
            Arrays (latent channels, 2 s, 2 s, 2 s).
        """
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

"""The factorised entropy model: for each channel a learned distribution of its integers.

References
----------
Ballé, Minnen, Singh, Hwang, Johnston: "Variational image compression with a scale hyperprior",
ICLR 2018, appendix 6.1: a small monotone network is the cumulative distribution.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import softplus

FILTERS = (1, 3, 3, 3, 1)
"""Widths of the layers of the monotone network."""
LIKELIHOOD_BOUND = 1e-9
"""No integer is held less likely, so that no gradient is infinite."""
_TOTAL_BITS = 22
_MAX_MAGNITUDE = 4096
_TAIL_MASS = 2.0**-20


class EntropyBottleneck(nn.Module):
    """Learned distributions of independent channels, named as in CompressAI.

    Parameters
    ----------
    channels
        Number of distributions.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels
        layers = list(pairwise(FILTERS))
        start = np.log(np.expm1(1 / 10 ** (1 / len(layers))))
        self.matrices = nn.ParameterList(
            torch.full((channels, b, a), float(start - np.log(b))) for a, b in layers
        )
        self.biases = nn.ParameterList(torch.rand(channels, b, 1) - 0.5 for _, b in layers)
        self.factors = nn.ParameterList(torch.zeros(channels, b, 1) for _, b in layers)

    def logits_cumulative(self, values: Tensor) -> Tensor:
        """Logit of P(x < value) of values (channels, 1, n), in the same shape."""
        for matrix, bias, factor in zip(self.matrices, self.biases, self.factors, strict=True):
            values = softplus(matrix) @ values + bias
            values = values + factor.tanh() * values.tanh()
        return values

    def likelihood(self, latent: Tensor) -> Tensor:
        """Probability of the unit interval around each value (n, channels), in the same shape."""
        values = latent.T[:, None]
        lower, upper = self.logits_cumulative(values - 0.5), self.logits_cumulative(values + 0.5)
        sign = -torch.sign(lower + upper).detach()  # the tail where sigmoids are told apart
        mass = (torch.sigmoid(sign * upper) - torch.sigmoid(sign * lower)).abs()
        return mass[:, 0].T.clamp_min(LIKELIHOOD_BOUND)


@dataclass(frozen=True)
class FrequencyTable:
    """Integer frequencies of one channel's values, for an entropy coder.

    Parameters
    ----------
    lowest
        The value of the first entry.
    frequencies
        (n,); the last entry is that of the escape symbol, for all values outside the table.
    """

    lowest: int
    frequencies: NDArray[np.int32]


def frequency_tables(bottleneck: EntropyBottleneck) -> tuple[FrequencyTable, ...]:
    """The tables of the channels, in double precision, without 2**-20 of the mass at either end."""
    with torch.no_grad():
        exact = EntropyBottleneck(bottleneck.channels).double()
        exact.load_state_dict(bottleneck.state_dict())
        edges = torch.arange(-_MAX_MAGNITUDE, _MAX_MAGNITUDE + 1, dtype=torch.float64) - 0.5
        below = exact.logits_cumulative(edges.expand(bottleneck.channels, 1, -1)).sigmoid()
    return tuple(_frequency_table(channel) for channel in below[:, 0].numpy())


def _frequency_table(cumulative: NDArray[np.float64]) -> FrequencyTable:
    first = max(int(np.searchsorted(cumulative, _TAIL_MASS)) - 1, 0)
    last = min(int(np.searchsorted(cumulative, 1 - _TAIL_MASS)), len(cumulative) - 1)
    last = max(last, first + 1)
    masses = np.append(np.diff(cumulative[first : last + 1]), _TAIL_MASS)
    frequencies = np.maximum(np.rint(masses * 2**_TOTAL_BITS), 1).astype(np.int32)
    return FrequencyTable(first - _MAX_MAGNITUDE, frequencies)

"""The factorised entropy model: for each channel a learned distribution of its integers.

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
LEAST = 1e-9
"""No integer is held less likely, so that no gradient is infinite."""
_TOTAL_BITS = 22
_WIDEST = 4096
_TAIL = 2.0**-20


class Bottleneck(nn.Module):
    """Distributions of `channels` independent channels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels
        steps = list(pairwise(FILTERS))
        start = np.log(np.expm1(1 / 10 ** (1 / len(steps))))
        self.matrices = nn.ParameterList(
            torch.full((channels, b, a), float(start - np.log(b))) for a, b in steps
        )
        self.biases = nn.ParameterList(torch.rand(channels, b, 1) - 0.5 for _, b in steps)
        self.factors = nn.ParameterList(torch.zeros(channels, b, 1) for _, b in steps)

    def cumulative(self, values: Tensor) -> Tensor:
        """Logit of P(x < value): (channels, 1, n) to the same."""
        for matrix, bias, factor in zip(self.matrices, self.biases, self.factors, strict=True):
            values = softplus(matrix) @ values + bias
            values = values + factor.tanh() * values.tanh()
        return values

    def likelihood(self, latent: Tensor) -> Tensor:
        """Probability of the unit interval around each value: (n, channels) to the same."""
        values = latent.T[:, None]
        low, high = self.cumulative(values - 0.5), self.cumulative(values + 0.5)
        side = -torch.sign(low + high).detach()  # the tail where sigmoids are told apart
        mass = (torch.sigmoid(side * high) - torch.sigmoid(side * low)).abs()
        return mass[:, 0].T.clamp_min(LEAST)


@dataclass(frozen=True)
class Table:
    """Frequencies of one channel's integers, from `lowest` on; the last one is the escape's."""

    lowest: int
    frequencies: NDArray[np.int32]


def tables(bottleneck: Bottleneck) -> tuple[Table, ...]:
    """The integer tables of a bottleneck, made once in double precision and then only read.

    A channel's table covers all but 2**-20 of its probability at either end.
    """
    with torch.no_grad():
        exact = Bottleneck(bottleneck.channels).double()
        exact.load_state_dict(bottleneck.state_dict())
        edges = torch.arange(-_WIDEST, _WIDEST + 1, dtype=torch.float64) - 0.5
        below = exact.cumulative(edges.expand(bottleneck.channels, 1, -1)).sigmoid()
    return tuple(_table(channel) for channel in below[:, 0].numpy())


def _table(below: NDArray[np.float64]) -> Table:
    first = max(int(np.searchsorted(below, _TAIL)) - 1, 0)
    last = min(int(np.searchsorted(below, 1 - _TAIL)), len(below) - 1)
    last = max(last, first + 1)
    masses = np.append(np.diff(below[first : last + 1]), _TAIL)
    frequencies = np.maximum(np.rint(masses * 2**_TOTAL_BITS), 1).astype(np.int32)
    return Table(first - _WIDEST, frequencies)

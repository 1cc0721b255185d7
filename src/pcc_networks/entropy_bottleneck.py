"""The entropy bottleneck (a learned distribution for each channel of a latent), and range coding.

The cumulative distribution is a small monotone network. For range coding, it is converted to
integer frequency tables.

References
----------
Ballé et al.: "Variational image compression with a scale hyperprior", ICLR 2018, appendix 6.1.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import softplus

from pointkit.errors import InputError

FILTERS = (1, 3, 3, 3, 1)
"""Widths of the layers of the monotone network."""
LIKELIHOOD_BOUND = 1e-9
"""Minimum likelihood, so that gradients stay finite."""
_TOTAL_BITS = 22
_MAX_MAGNITUDE = 4096
_TAIL_MASS = 2.0**-20


class EntropyBottleneck(nn.Module):
    """Learns one distribution for each channel of a latent.

    The parameters have the names that CompressAI gives them.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels
        layers = list(pairwise(FILTERS))
        initial = np.log(np.expm1(1 / 10 ** (1 / len(layers))))
        self.matrices = nn.ParameterList(
            torch.full((channels, b, a), float(initial - np.log(b))) for a, b in layers
        )
        self.biases = nn.ParameterList(torch.rand(channels, b, 1) - 0.5 for _, b in layers)
        self.factors = nn.ParameterList(torch.zeros(channels, b, 1) for _, b in layers)

    def logits_cumulative(self, values: Tensor) -> Tensor:
        """Return the logits of the probability P(x < value) for values (channels, 1, n)."""
        for matrix, bias, factor in zip(self.matrices, self.biases, self.factors, strict=True):
            values = softplus(matrix) @ values + bias
            values = values + factor.tanh() * values.tanh()
        return values

    def likelihood(self, latent: Tensor) -> Tensor:
        """Return the probability of the unit interval around each value of a latent.

        Both the latent and the result have the shape (n, channels).
        """
        values = latent.T[:, None]
        lower, upper = self.logits_cumulative(values - 0.5), self.logits_cumulative(values + 0.5)
        sign = -torch.sign(lower + upper).detach()  # the tail in which sigmoids are precise
        mass = (torch.sigmoid(sign * upper) - torch.sigmoid(sign * lower)).abs()
        return mass[:, 0].T.clamp_min(LIKELIHOOD_BOUND)


@dataclass(frozen=True)
class FrequencyTable:
    """Integer frequencies of the values of one channel, for range coding."""

    lowest: int  # value of the first entry
    # (n,); the last is of the escape symbol, for all values outside the table
    frequencies: NDArray[np.int32]


def frequency_tables(bottleneck: EntropyBottleneck) -> tuple[FrequencyTable, ...]:
    """Return a frequency table for each channel of a bottleneck.

    The tables are computed in double precision. Values in tails of probability 2**-20 have no
    entry, but share the escape symbol.
    """
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


Integers = NDArray[np.int32]
_ESCAPE_RANGE = 2**16
_WORD_BYTES = 4


def encode_latent(latent: Integers, tables: tuple[FrequencyTable, ...]) -> bytes:
    """Encode integers (n, channels) with a frequency table for each channel."""
    return encode_groups(zip(latent.T, tables, strict=True))


def decode_latent(data: bytes, count: int, tables: tuple[FrequencyTable, ...]) -> Integers:
    """Decode the integers (count, channels) that `encode_latent` encoded.

    Raises InputError if the data are damaged.
    """
    columns = decode_groups(data, [(count, table) for table in tables])
    return np.stack(columns, axis=1)


def encode_groups(groups: Iterable[tuple[Integers, FrequencyTable]]) -> bytes:
    """Encode groups of integers (n,), each with a frequency table.

    A value outside the table is coded as the escape symbol. Such values, clipped to 16 bits, follow
    after the group.
    """
    import constriction

    coder = constriction.stream.queue.RangeEncoder()
    for values, table in groups:
        escape = len(table.frequencies) - 1
        symbols = values.astype(np.int64) - table.lowest
        outside = (symbols < 0) | (symbols >= escape)
        coded = np.where(outside, escape, symbols).astype(np.int32)
        coder.encode(coded, _categorical(table))
        if outside.any():
            escaped = np.clip(values[outside] + _ESCAPE_RANGE // 2, 0, _ESCAPE_RANGE - 1)
            coder.encode(escaped.astype(np.int32), _escape_model())
    return bytes(coder.get_compressed().astype("<u4").tobytes())


def decode_groups(data: bytes, groups: Iterable[tuple[int, FrequencyTable]]) -> list[Integers]:
    """Decode groups of integers that `encode_groups` encoded.

    Parameters
    ----------
    data
        The bytes of all groups.
    groups
        Number of values and frequency table of each group.

    Raises
    ------
    InputError
        If the data are damaged.
    """
    with range_decoder(data, "features") as coder:
        return [_decode_group(coder, count, table) for count, table in groups]


@contextmanager
def range_decoder(data: bytes, part: str) -> Iterator[Any]:
    """Open a range decoder for the bytes of a part of a stream.

    Raises
    ------
    InputError
        If the data turn out to be damaged, or are not read to their end.
    """
    import constriction

    damaged = f"the stream is damaged ({part})"
    if len(data) % _WORD_BYTES:
        raise InputError(damaged)
    words = np.frombuffer(data, dtype="<u4").astype(np.uint32)
    coder = constriction.stream.queue.RangeDecoder(words)
    try:
        yield coder
    except (AssertionError, ValueError) as error:  # constriction's errors for impossible data
        raise InputError(damaged) from error
    if not coder.maybe_exhausted():
        raise InputError(damaged)


def _decode_group(coder: Any, count: int, table: FrequencyTable) -> Integers:
    escape = len(table.frequencies) - 1
    symbols: Integers = coder.decode(_categorical(table), count)
    values = symbols + np.int32(table.lowest)
    outside = symbols == escape
    if outside.any():
        escaped = coder.decode(_escape_model(), int(outside.sum()))
        values[outside] = escaped - _ESCAPE_RANGE // 2
    return values


def _categorical(table: FrequencyTable) -> Any:
    import constriction

    frequencies = table.frequencies.astype(np.float64)
    return constriction.stream.model.Categorical(frequencies, perfect=False)


def _escape_model() -> Any:
    import constriction

    return constriction.stream.model.Uniform(_ESCAPE_RANGE)

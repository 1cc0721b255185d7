"""Compiled layers of RENO: convolutions, and heads that end in cumulative frequencies.

Everything is computed in IEEE 754's arithmetic in one order, whatever the number of threads, so
that encoder and decoder agree to the last bit: see `add_fused_products`. The exponential function,
which libraries round differently, is computed here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.matrix_products import add_fused_products
from puckbench.core.compiling import compiled
from puckbench.learned.reno.weights import VALUES, Floats32
from puckbench.learned.sparse.voxels import OFFSETS, NeighbourTable

Symbols = NDArray[np.uint8]
Cumulative = NDArray[np.int32]
"""Cumulative frequencies (n, 17) of symbols' values: from 0 to 65,536, strictly rising."""
CDF_BITS = 16
_BLOCK_ROWS = 128
"""Rows whose sums stay in a core's nearest cache."""
_ZERO = np.float32(0)
_SPREAD = float(2**CDF_BITS - VALUES)
"""What is left of all frequencies when each value has one."""
_LEAST_EXPONENT = 64
_POWERS = 2.0 ** np.arange(-_LEAST_EXPONENT, 1)
_TERMS = np.array([1 / math.factorial(n) for n in range(13, -1, -1)])
_LOG2_E, _LN_2 = 1 / math.log(2), math.log(2)


@cache
def convolution(channels: int) -> Callable[..., None]:
    """A compiled 3x3x3 convolution and ReLU, before which other features may be added.

    Features of voxels outside the set count as zero. The sum of a row begins with the features
    that are added, then come its neighbours by their offsets, x fastest.
    """

    def convolve(
        table: NeighbourTable, features: Floats32, kernel: Floats32, added: Floats32, first: int,
        last: int, made: Floats32,
    ) -> None:  # fmt: skip
        sums = np.empty(_BLOCK_ROWS * channels, np.float32)
        targets, sources = np.empty(_BLOCK_ROWS, np.int64), np.empty(_BLOCK_ROWS, np.int64)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for k in range(count * channels):
                sums[k] = added[start * channels + k] if len(added) > 0 else _ZERO
            for offset in range(OFFSETS):
                pairs = 0
                for i in range(count):
                    other = table[offset, start + i]
                    # overwritten by the next one if there is none
                    targets[pairs], sources[pairs] = i, other
                    pairs += other >= 0
                add_fused_products(
                    sums, targets, features, sources, pairs, kernel, offset * channels * channels,
                    channels, channels,
                )  # fmt: skip
            for k in range(count * channels):
                made[start * channels + k] = max(sums[k], _ZERO)

    return compiled(convolve)


@cache
def head(channels: int) -> Callable[..., None]:
    """A compiled head: features of some rows to cumulative frequencies of their symbols."""

    def predict(
        features: Floats32, first: int, last: int, hidden: Floats32, hidden_bias: Floats32,
        logits: Floats32, logits_bias: Floats32, embedding: Floats32, symbols: Symbols,
        predicted: Cumulative,
    ) -> None:  # fmt: skip
        read, made = np.empty((2, _BLOCK_ROWS * channels), np.float32)
        sums = np.empty(_BLOCK_ROWS * VALUES, np.float32)
        every = np.arange(_BLOCK_ROWS)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for i in range(count):
                for j in range(channels):
                    value = features[(start + i) * channels + j]
                    if len(symbols) > 0:
                        value += embedding[np.int64(symbols[start + i]) * channels + j]
                    read[i * channels + j] = value
                    made[i * channels + j] = hidden_bias[j]
            add_fused_products(made, every, read, every, count, hidden, 0, channels, channels)
            for k in range(count * channels):
                read[k] = max(made[k], _ZERO)
            for k in range(count * VALUES):
                sums[k] = logits_bias[k % VALUES]
            add_fused_products(sums, every, read, every, count, logits, 0, channels, VALUES)
            for i in range(count):
                cumulate(sums, i * VALUES, predicted[start + i])

    return compiled(predict)


@compiled
def cumulate(logits: Floats32, at: int, into: Cumulative) -> None:
    """The cumulative frequencies (17,) of 16 logits, as the authors' program rounds them.

    Its softmax is summed, multiplied by 2^16 - 16, and rounded; then each value gets one more.
    Logits that are not finite give equal frequencies.
    """
    most = np.float64(logits[at])
    for j in range(1, VALUES):
        most = max(most, np.float64(logits[at + j]))
    total = 0.0
    for j in range(VALUES):
        total += exponential(np.float64(logits[at + j]) - most)
    below = 0.0
    for j in range(VALUES):
        share = below / total if total >= 1.0 and total <= VALUES else j / VALUES
        into[j] = np.int64(math.floor(share * _SPREAD + 0.5)) + j
        below += exponential(np.float64(logits[at + j]) - most)
    into[VALUES] = 2**CDF_BITS


@compiled
def exponential(x: float) -> float:
    """The exponential of a number that is at most 0, to about 1e-14; of less than -44 it is 0."""
    if not -44.0 < x <= 0.0:
        return 0.0 * x  # not a number where x is none, or infinite
    power = math.floor(x * _LOG2_E + 0.5)
    rest = x - power * _LN_2
    total = _TERMS[0]
    for k in range(1, len(_TERMS)):
        total = total * rest + _TERMS[k]
    result: float = total * _POWERS[np.int64(power) + _LEAST_EXPONENT]
    return result

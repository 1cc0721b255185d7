"""Adaptive binary arithmetic coding: each bit's probability is mixed from several contexts.

A context's own estimate is an adaptive probability; the estimates are mixed in the logistic domain
by weights that are learnt on the way (Mahoney 2005, "Adaptive weighing of context models for
lossless data compression"). All arithmetic is on integers, so that every machine decodes the same.
One function codes both ways: it writes the bit it is given, or reads one and returns it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.common.binary_coder import (
    ENDS,
    ONE,
    SLOWEST,
    BitCoder,
    bit_reader,
    bit_writer,
    code,
    code_gamma,
    learning_rates,
    logistic_tables,
)
from puckbench.core.compiling import compiled_in_place

Ints = NDArray[np.int64]
_RATE = 14


class Coder(NamedTuple):
    """State of a coder: where the bits are, and what it has learnt.

    chances, seen: (contexts,) probability of a 1 and number of bits seen. weights: (mixers, 3).
    stretch, squash, rates: tables.
    """

    bits: BitCoder
    chances: Ints
    seen: Ints
    weights: Ints
    stretch: Ints
    squash: Ints
    rates: Ints


def writer(contexts: int, mixers: int, most_bytes: int) -> Coder:
    """A coder that writes at most `most_bytes` bytes."""
    return _coder(bit_writer(most_bytes), contexts, mixers)


def reader(stream: bytes, contexts: int, mixers: int) -> Coder:
    """A coder that reads a stream."""
    return _coder(bit_reader(stream), contexts, mixers)


def _coder(bits: BitCoder, contexts: int, mixers: int) -> Coder:
    return Coder(
        bits,
        np.full(contexts, ONE // 2, np.int64),
        np.zeros(contexts, np.int64),
        np.full((mixers, 3), int(0.4 * ONE), np.int64),
        *logistic_tables(),
        learning_rates(),
    )


@compiled_in_place
def code_bit(coder: Coder, bit: int, mixer: int, contexts: tuple[int, int, int]) -> int:
    """Code a bit in three contexts, mixed by the weights of `mixer`; the bit."""
    a, b, c = contexts
    weights, stretch = coder.weights[mixer], coder.stretch
    s_a = stretch[coder.chances[a] >> 4]
    s_b = stretch[coder.chances[b] >> 4]
    s_c = stretch[coder.chances[c] >> 4]
    mixed = (weights[0] * s_a + weights[1] * s_b + weights[2] * s_c) >> 16
    chance = coder.squash[min(max(mixed, -ENDS), ENDS - 1) + ENDS]
    bit = code(coder.bits, bit, chance)
    error = (bit * ONE - chance) * _RATE
    weights[0] += (s_a * error + (1 << 17)) >> 18
    weights[1] += (s_b * error + (1 << 17)) >> 18
    weights[2] += (s_c * error + (1 << 17)) >> 18
    _learn(coder, a, bit)
    _learn(coder, b, bit)
    _learn(coder, c, bit)
    return bit


@compiled_in_place
def _learn(coder: Coder, context: int, bit: int) -> None:
    seen = coder.seen[context]
    coder.chances[context] += ((bit * 65535 - coder.chances[context]) * coder.rates[seen]) >> 16
    if seen < SLOWEST:
        coder.seen[context] = seen + 1


@compiled_in_place
def code_number(coder: Coder, value: int, mixer: int, base: int, base_b: int) -> int:
    """Code a signed whole number, small ones cheaply; `base`, `base_b`: 40 contexts from each on.

    Zero or not, sign, then the magnitude: unary up to 12, the rest in Elias-gamma code.
    """
    if code_bit(coder, 1 if value == 0 else 0, mixer, (base, base_b, base)) == 1:
        return 0
    contexts = (base + 1, base_b + 1, base + 1)
    negative = code_bit(coder, 1 if value < 0 else 0, mixer + 1, contexts)
    magnitude = abs(value)
    for k in range(1, 13):
        contexts = (base + 1 + k, base_b + 1 + k, base + 1 + k)
        if code_bit(coder, 1 if magnitude > k else 0, mixer + 2, contexts) == 0:
            return -k if negative == 1 else k
    rest = 12 + code_gamma(coder.bits, magnitude - 12)
    return -rest if negative == 1 else rest

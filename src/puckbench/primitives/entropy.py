"""Context-mixing binary arithmetic coding: a bit's probability is mixed from three contexts.

Each context has an adaptive probability; the three are mixed in the logistic domain with weights
that are learnt while coding (Mahoney 2005, "Adaptive weighing of context models for lossless data
compression"). All arithmetic is on integers, so that every machine decodes the same. Encoder and
decoder run the same functions, which write the bit that they are given, or read and return one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.binary_coder import (
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
_LEARNING_RATE = 14
_LONGEST_UNARY = 12
NUMBER_CONTEXTS = 40
"""Contexts that `code_number` needs from each of its first ones on."""


class Coder(NamedTuple):
    """State of a coder: the arithmetic coder and the adaptive statistics.

    probabilities, counts: (contexts,) probability of a 1, and bits seen so far. weights:
    (mixers, 3). stretch, squash, rates: tables of the logistic domain and of the learning rates.
    """

    bits: BitCoder
    probabilities: Ints
    counts: Ints
    weights: Ints
    stretch: Ints
    squash: Ints
    rates: Ints


def writer(contexts: int, mixers: int, max_bytes: int) -> Coder:
    """A coder that writes at most `max_bytes` bytes."""
    return _coder(bit_writer(max_bytes), contexts, mixers)


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
    """Code a bit in three contexts, mixed by the weights of `mixer`; returns the bit."""
    a, b, c = contexts
    weights, stretch = coder.weights[mixer], coder.stretch
    s_a = stretch[coder.probabilities[a] >> 4]
    s_b = stretch[coder.probabilities[b] >> 4]
    s_c = stretch[coder.probabilities[c] >> 4]
    mixed = (weights[0] * s_a + weights[1] * s_b + weights[2] * s_c) >> 16
    probability = coder.squash[min(max(mixed, -ENDS), ENDS - 1) + ENDS]
    bit = code(coder.bits, bit, probability)
    error = (bit * ONE - probability) * _LEARNING_RATE
    weights[0] += (s_a * error + (1 << 17)) >> 18
    weights[1] += (s_b * error + (1 << 17)) >> 18
    weights[2] += (s_c * error + (1 << 17)) >> 18
    _update(coder, a, bit)
    _update(coder, b, bit)
    _update(coder, c, bit)
    return bit


@compiled_in_place
def _update(coder: Coder, context: int, bit: int) -> None:
    """Move the adaptive probability of a context towards a coded bit."""
    count, probabilities = coder.counts[context], coder.probabilities
    probabilities[context] += ((bit * 65535 - probabilities[context]) * coder.rates[count]) >> 16
    if count < SLOWEST:
        coder.counts[context] = count + 1


@compiled_in_place
def code_number(coder: Coder, value: int, mixer: int, base: int, base_b: int) -> int:
    """Code a signed integer: zero flag, sign, unary magnitude up to 12, the rest Elias gamma.

    base, base_b: first of `NUMBER_CONTEXTS` contexts each. mixer: first of three.
    """
    if code_bit(coder, 1 if value == 0 else 0, mixer, (base, base_b, base)) == 1:
        return 0
    contexts = (base + 1, base_b + 1, base + 1)
    negative = code_bit(coder, 1 if value < 0 else 0, mixer + 1, contexts)
    magnitude = abs(value)
    for k in range(1, _LONGEST_UNARY + 1):
        contexts = (base + 1 + k, base_b + 1 + k, base + 1 + k)
        if code_bit(coder, 1 if magnitude > k else 0, mixer + 2, contexts) == 0:
            return -k if negative == 1 else k
    rest = _LONGEST_UNARY + code_gamma(coder.bits, magnitude - _LONGEST_UNARY)
    return -rest if negative == 1 else rest

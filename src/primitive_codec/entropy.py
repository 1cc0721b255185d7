"""Binary arithmetic coding, in which the probability of each bit is mixed from three contexts.

Each context has an adaptive probability. The three are mixed in the logistic domain with learnt
weights (Mahoney 2005, "Adaptive weighing of context models for lossless data compression"). The
arithmetic is in integers, so that all machines decode identically. Each ``code_...`` function
serves both directions: with a `writer` it encodes its argument, with a `reader` it decodes and
returns it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import (
    LOGIT_LIMIT,
    MAX_MEMORY,
    ONE,
    WRITING,
    BitCoder,
    bit_reader,
    bit_writer,
    code,
    code_gamma,
    learning_rates,
    logistic_tables,
)
from pointkit.compiling import compiled_in_place
from primitive_codec.octree_arrays import Ints

_LEARNING_RATE = 14
_MAX_UNARY = 12
CONTEXTS_PER_NUMBER = 40
"""Number of contexts that `code_number` uses from each of `first_a` and `first_b` on."""


class ContextCoder(NamedTuple):
    """An arithmetic coder for one direction, with the state of its contexts and mixers."""

    bits: BitCoder
    probabilities: Ints  # (contexts,) of a 1
    counts: Ints  # (contexts,) numbers of coded bits
    weights: Ints  # (mixers, 3)
    stretch: Ints  # table of the logit
    squash: Ints  # table of its inverse
    rates: Ints  # table of the adaptation rates by count


def writer(contexts: int, mixers: int, max_bytes: int) -> ContextCoder:
    """Return a coder that encodes.

    Parameters
    ----------
    contexts, mixers
        Number of contexts and of sets of mixing weights.
    max_bytes
        Largest length of the stream.
    """
    return _coder(bit_writer(max_bytes), contexts, mixers)


def reader(stream: bytes, contexts: int, mixers: int) -> ContextCoder:
    """Return a coder that decodes a stream, with as many contexts and mixers as the writer had."""
    return _coder(bit_reader(stream), contexts, mixers)


def _coder(bits: BitCoder, contexts: int, mixers: int) -> ContextCoder:
    return ContextCoder(
        bits,
        np.full(contexts, ONE // 2, np.int64),
        np.zeros(contexts, np.int64),
        np.full((mixers, 3), int(0.4 * ONE), np.int64),
        *logistic_tables(),
        learning_rates(),
    )


@compiled_in_place
def is_writing(coder: ContextCoder) -> bool:
    """Return whether a coder encodes; otherwise it decodes."""
    return bool(coder.bits.registers[WRITING] == 1)


@compiled_in_place
def code_bit(coder: ContextCoder, bit: int, mixer: int, contexts: tuple[int, int, int]) -> int:
    """Encode or decode a bit, and adapt its contexts and its mixer.

    Parameters
    ----------
    coder
        Arithmetic coder of either direction.
    bit
        Bit to encode; ignored when decoding.
    mixer
        Index of the mixing weights.
    contexts
        Indices of the three contexts.

    Returns
    -------
    int
        The encoded or decoded bit.
    """
    a, b, c = contexts
    weights, stretch = coder.weights[mixer], coder.stretch
    a_logit = stretch[coder.probabilities[a] >> 4]
    b_logit = stretch[coder.probabilities[b] >> 4]
    c_logit = stretch[coder.probabilities[c] >> 4]
    mixed = (weights[0] * a_logit + weights[1] * b_logit + weights[2] * c_logit) >> 16
    probability = coder.squash[min(max(mixed, -LOGIT_LIMIT), LOGIT_LIMIT - 1) + LOGIT_LIMIT]
    bit = code(coder.bits, bit, probability)
    error = (bit * ONE - probability) * _LEARNING_RATE
    weights[0] += (a_logit * error + (1 << 17)) >> 18
    weights[1] += (b_logit * error + (1 << 17)) >> 18
    weights[2] += (c_logit * error + (1 << 17)) >> 18
    _update(coder, a, bit)
    _update(coder, b, bit)
    _update(coder, c, bit)
    return bit


@compiled_in_place
def _update(coder: ContextCoder, context: int, bit: int) -> None:
    count, probabilities = coder.counts[context], coder.probabilities
    probabilities[context] += ((bit * 65535 - probabilities[context]) * coder.rates[count]) >> 16
    if count < MAX_MEMORY:
        coder.counts[context] = count + 1


@compiled_in_place
def code_number(coder: ContextCoder, value: int, mixer: int, first_a: int, first_b: int) -> int:
    """Encode or decode a signed integer.

    The number is coded as a zero flag, a sign and a magnitude; magnitudes above 12 in Elias's gamma
    code.

    Parameters
    ----------
    coder
        Arithmetic coder of either direction.
    value
        Number to encode; ignored when decoding.
    mixer
        Index of the first of the three mixers that are used.
    first_a, first_b
        Indices of the first of `CONTEXTS_PER_NUMBER` contexts in each of two sets.

    Returns
    -------
    int
        The encoded or decoded number.
    """
    if code_bit(coder, 1 if value == 0 else 0, mixer, (first_a, first_b, first_a)) == 1:
        return 0
    contexts = (first_a + 1, first_b + 1, first_a + 1)
    negative = code_bit(coder, 1 if value < 0 else 0, mixer + 1, contexts)
    magnitude = abs(value)
    for k in range(1, _MAX_UNARY + 1):
        contexts = (first_a + 1 + k, first_b + 1 + k, first_a + 1 + k)
        if code_bit(coder, 1 if magnitude > k else 0, mixer + 2, contexts) == 0:
            return -k if negative == 1 else k
    escaped = _MAX_UNARY + code_gamma(coder.bits, magnitude - _MAX_UNARY)
    return -escaped if negative == 1 else escaped

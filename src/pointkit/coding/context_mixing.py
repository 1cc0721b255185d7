"""Context mixing in integer arithmetic: it combines several estimates of a bit's probability.

An estimate is a logit. It comes either from an *expert*, i.e. the caller computes it, or from a
*context*, i.e. an adaptive counter that the caller selects gives it. A mixture is the sum of all
estimates, weighted by one row of a set of learnt weights; the caller selects the row of each set.
The mixtures of all sets are averaged, and adaptive tables correct the average (secondary
estimation). See Mahoney 2005, "Adaptive weighing of context models for lossless data compression".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.binary_coder import (
    LOGIT_LIMIT,
    MIN_PROBABILITY,
    ONE,
    BitCoder,
    code,
    learning_rates,
    logistic_tables,
)
from pointkit.coding.intrinsics import Lanes, add_scaled, dot, lanes_for
from pointkit.compiling import inlined

Ints = NDArray[np.int64]
Words = NDArray[np.int32]
Counters = NDArray[np.int32] | NDArray[np.uint32]
Integers = NDArray[np.integer[Any]]
PROBABILITY_BITS = 22
"""Adaptive probabilities are in units of 2**-22."""
COUNT_BITS = 9
"""Low bits of a counter for the number of coded bits; the other bits hold the probability."""
CERTAINTY = (1 << PROBABILITY_BITS) - 1
"""The probability 1 in a counter's units."""
BUCKETS = 33
"""Number of entries of a correction table, at equally spaced logits."""
BIAS = 77
"""Constant logit among the inputs of every mixture."""


@dataclass(frozen=True, kw_only=True)
class MixerOptions:
    """Sizes and learning rates of a `Mixer`; encoder and decoder must use the same ones.

    Parameters
    ----------
    contexts
        Number of contexts. For each bit, the caller selects one counter of each context.
    counters
        Total number of counters (adaptive probabilities) of all contexts.
    rows
        Total number of rows of weights in all sets.
    weights
        Initial weights: first of the experts, then of the contexts.
    experts
        Number of estimates that the caller computes as logits.
    learning_rate, final_learning_rate
        Rates at which weights follow errors, at the first bit and after many bits.
    memory
        Number of coded bits after which a counter adapts at a constant rate.
    sets
        Number of sets of weights. For each bit, the caller selects one row of each set.
    tables
        Number of sets that also select a correction table: 1 for the first set, 2 for the first
        two.
    """

    contexts: int
    counters: int
    rows: int
    weights: Sequence[float]
    experts: int = 0
    learning_rate: int = 14
    final_learning_rate: int = 3
    memory: int = 160
    sets: int = 1
    tables: int = 1


class MixerSizes(NamedTuple):
    """Sizes of a mixer, each as a tuple whose length is a constant for compiled code."""

    experts: Lanes
    contexts: Lanes
    sets: Lanes
    tables: Lanes
    lanes: Lanes


class Mixer(NamedTuple):
    """State of context mixing, which `code_bit` uses to encode or decode bits.

    Before each bit, the caller writes the experts' logits to `inputs`, the index of one counter of
    each context to `contexts`, and the index of one row of weights of each set to `rows`.

    Parameters
    ----------
    bits
        The arithmetic coder, which determines whether bits are encoded or decoded.
    counters
        Adaptive probabilities of all contexts, (counters,). Each holds the probability of a 1 and
        the number of coded bits.
    weights
        Rows of weights, (rows * lanes,). A row has the weights of the experts, the contexts and the
        bias.
    learning
        Initial, final and current learning rate, and number of coded bits.
    """

    bits: BitCoder
    counters: NDArray[np.uint32]
    weights: Words
    corrections: Words
    inputs: Words
    contexts: Ints
    rows: Ints
    mixtures: Ints
    stretch: NDArray[np.int16]
    squash: NDArray[np.uint16]
    rates: Words
    learning: Ints
    memory: int
    sizes: MixerSizes


def new_mixer(bits: BitCoder, options: MixerOptions) -> Mixer:
    """Return a mixer in the initial state, before it has learnt from any bit.

    Parameters
    ----------
    bits
        From `bit_writer` to encode, or from `bit_reader` to decode.
    options
        Sizes and learning rates; encoder and decoder must use the same ones.
    """
    inputs = options.experts + options.contexts
    lanes = lanes_for(inputs + 1)
    weights = np.zeros((options.rows, len(lanes)), np.int32)
    weights[:, :inputs] = [round(weight * ONE) for weight in options.weights]
    first_inputs = np.zeros(len(lanes), np.int32)
    first_inputs[inputs] = BIAS
    stretch, squash = logistic_tables()
    rate, final_rate = options.learning_rate, options.final_learning_rate
    sizes = MixerSizes(
        (0,) * options.experts,
        (0,) * options.contexts,
        (0,) * options.sets,
        (0,) * options.tables,
        lanes,
    )
    return Mixer(
        bits,
        new_counters(options.counters).view(np.uint32),
        weights.ravel(),
        new_corrections(options.rows),
        first_inputs,
        np.zeros(options.contexts, np.int64),
        np.zeros(options.sets, np.int64),
        np.zeros(options.sets, np.int64),
        stretch.astype(np.int16),
        squash.astype(np.uint16),
        learning_rates().astype(np.int32),
        np.array([rate, final_rate, rate, 0], np.int64),
        options.memory,
        sizes,
    )


def new_counters(count: int) -> NDArray[np.int32]:
    """Return `count` counters, (count,), with the probability 1 / 2 and no coded bit."""
    return np.full(count, 1 << PROBABILITY_BITS + COUNT_BITS - 1, np.int32)


def new_corrections(rows: int) -> Words:
    """Return correction tables (rows, buckets) that initially change no probability."""
    _, squash = logistic_tables()
    steps = np.minimum(np.arange(BUCKETS) * 128, 2 * LOGIT_LIMIT - 1)
    return np.tile((squash[steps] << PROBABILITY_BITS - 16).astype(np.int32), (rows, 1))


@inlined
def code_bit(mixer: Mixer, bit: int, node: int, row: int) -> int:
    """Encode or decode a bit whose probability the mixer estimates, and learn from the bit.

    Parameters
    ----------
    mixer
        The mixer. Before the call, the caller sets `contexts`, `rows` and, with experts, `inputs`.
        The mixer's arithmetic coder determines whether the bit is encoded or decoded.
    bit
        The bit to encode, 0 or 1; ignored when decoding.
    node, row
        Numbers that are added to each element of `contexts` and to each element of `rows`. They
        distinguish the successive bits of one number.

    Returns
    -------
    int
        The bit that was encoded or decoded.
    """
    sizes, inputs, weights = mixer.sizes, mixer.inputs, mixer.weights
    experts, sets, width = len(sizes.experts), len(sizes.sets), len(sizes.lanes)
    tables = len(sizes.tables)
    for k in range(len(sizes.contexts)):
        counter = mixer.contexts[k] + node
        inputs[experts + k] = logit_of(mixer.counters, counter, mixer.stretch)
    total = 0
    for k in range(sets):
        mixed = dot(weights, (mixer.rows[k] + row) * width, inputs, 0, sizes.lanes) >> 16
        mixed = min(max(mixed, -LOGIT_LIMIT), LOGIT_LIMIT - 1)
        mixer.mixtures[k] = mixed
        total += mixed
    level = total // sets + LOGIT_LIMIT
    bucket, share = level >> 7, level & 127
    # Half is the mixture, half its corrections: a sum of 2 or 4 probabilities.
    probability = tables * int(mixer.squash[np.uint64(level)])
    for k in range(tables):
        probability += corrected(mixer.corrections, mixer.rows[k] + row, bucket, share)
    bit = code(
        mixer.bits, bit, min(max(probability >> tables, MIN_PROBABILITY), ONE - MIN_PROBABILITY)
    )
    for k in range(tables):
        learn_correction(mixer.corrections, mixer.rows[k] + row, bucket, share, bit * CERTAINTY)
    rate = _learning_rate(mixer.learning)
    for k in range(sets):
        error = (bit * ONE - int(mixer.squash[np.uint64(mixer.mixtures[k] + LOGIT_LIMIT)])) * rate
        add_scaled(weights, (mixer.rows[k] + row) * width, inputs, error, 18, sizes.lanes)
    for k in range(len(sizes.contexts)):
        counter = mixer.contexts[k] + node
        learn_bit(mixer.counters, counter, bit * CERTAINTY, mixer.rates, mixer.memory)
    return bit


@inlined
def _learning_rate(learning: Ints) -> int:
    coded = learning[3]
    if coded & 7 == 0:
        learning[2] = learning[1] + ((learning[0] - learning[1]) * 256) // (256 + (coded >> 3))
    learning[3] = coded + 1
    return int(learning[2])


@inlined
def logit_of(counters: Counters, counter: int, stretch: Integers) -> int:
    """Return the logit, in units of 1 / 256, of a counter's probability of a 1."""
    state = np.int64(counters[np.uint64(counter)])
    return int(stretch[np.uint64(state >> COUNT_BITS + PROBABILITY_BITS - 12)])


@inlined
def learn_bit(counters: Counters, counter: int, target: int, rates: Integers, memory: int) -> None:
    """Move a counter's probability towards a coded bit; `target` is the bit times `CERTAINTY`."""
    place = np.uint64(counter)  # Numba would test whether a signed index is negative
    state = np.int64(counters[place])
    seen = state & ((1 << COUNT_BITS) - 1)
    step = ((target - (state >> COUNT_BITS)) * rates[np.uint64(seen)]) >> 16
    counters[place] = state + (step << COUNT_BITS) + (1 if seen < memory else 0)


@inlined
def corrected(corrections: Integers, row: int, bucket: int, share: int) -> int:
    """Return the corrected probability of a 1, interpolated between two buckets of a row.

    `share` is the weight of the second bucket in units of 1 / 128.
    """
    place = np.uint64(row), np.uint64(bucket)
    after = np.uint64(row), np.uint64(bucket + 1)
    left, right = corrections[place], corrections[after]
    return int((left * (128 - share) + right * share) >> 13)


@inlined
def learn_correction(corrections: Integers, row: int, bucket: int, share: int, target: int) -> None:
    """Move two adjacent buckets towards a coded bit; `target` is the bit times `CERTAINTY`."""
    place = np.uint64(row), np.uint64(bucket)
    after = np.uint64(row), np.uint64(bucket + 1)
    corrections[place] += ((target - corrections[place]) * (128 - share)) >> 14
    corrections[after] += ((target - corrections[after]) * share) >> 14

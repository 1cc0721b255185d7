"""Context mixing: a bit's probability from several adaptive estimates, in integer arithmetic.

An outside estimate (a network's, a table's) and the estimates of adaptive contexts are mixed in the
logistic domain by weights that are learnt while coding. There may be several sets of weights, each
selected by another property of the bit; their mixtures are averaged and then corrected by adaptive
tables of how often a bit was 1 at that mixture (secondary estimation).

References
----------
Mahoney 2005, "Adaptive weighing of context models for lossless data compression".
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.binary_coder import (
    ENDS,
    LEAST,
    ONE,
    BitCoder,
    code,
    learning_rates,
    logistic_tables,
)
from puckbench.core.compiling import compiled_in_place, inlined

Ints = NDArray[np.int64]
Slots = NDArray[np.int32]
Counters = Slots | NDArray[np.uint32]
Numbers = NDArray[np.signedinteger[Any]]
"""Of 32 or 64 bits."""
FINE_BITS = 22
"""Adaptive probabilities are in units of 2**-22."""
SEEN_BITS = 9
"""Lowest bits of a context's state, below its probability: number of bits seen so far."""
CERTAIN = (1 << FINE_BITS) - 1
BUCKETS = 33
BIAS = 77
"""Constant input of every mixture, in units of the logistic domain."""
_TABLES = 2
"""Most correction tables, selected as the first sets of weights are."""


class MixerSettings(NamedTuple):
    """How a mixer begins and learns.

    Parameters
    ----------
    estimate, context
        Initial weights of the outside estimate and of each context's estimate.
    learning_rate
        Of the weights.
    memory
        Of a context's adaptive probability, in bits; at most `SLOWEST`.
    """

    estimate: float
    context: float
    learning_rate: int
    memory: int


class Mixer(NamedTuple):
    """State of a coder that mixes contexts.

    bits: the arithmetic coder. contexts: (contexts,) probability of a 1 and number of bits seen of
    each. weights: (rows, inputs), the rows of all sets. corrected: (rows, buckets), probability of
    a 1 by the mixture's bucket. stretch, squash, rates: tables of `binary_coder`. at: (contexts of
    a bit,), the contexts of the next bit; rows: (sets,), its weights' rows; inputs, mixtures:
    workspace. learning_rate, memory: see `MixerSettings`.
    """

    bits: BitCoder
    contexts: Slots
    weights: Ints
    corrected: Ints
    stretch: Ints
    squash: Ints
    rates: Ints
    at: Ints
    rows: Ints
    inputs: Ints
    mixtures: Ints
    learning_rate: int
    memory: int


def mixer(
    bits: BitCoder, contexts: int, inputs: int, rows: int, sets: int, settings: MixerSettings
) -> Mixer:
    """A coder in its initial state.

    Parameters
    ----------
    bits
        Writes or reads the stream.
    contexts
        Number of contexts in all.
    inputs
        Number of contexts of one bit.
    rows
        Number of rows of weights in all sets together.
    sets
        Number of sets of weights.
    settings
        Initial weights, learning rate and memory.
    """
    stretch, squash = logistic_tables()
    weights = np.full((rows, inputs + 2), round(settings.context * ONE), np.int64)
    weights[:, 0], weights[:, -1] = round(settings.estimate * ONE), 0
    return Mixer(
        bits,
        new_counters(contexts),
        weights,
        new_corrections(rows),
        stretch,
        squash,
        learning_rates(),
        np.zeros(inputs, np.int64),
        np.zeros(sets, np.int64),
        np.zeros(inputs + 2, np.int64),
        np.zeros(sets, np.int64),
        settings.learning_rate,
        settings.memory,
    )


def new_counters(count: int) -> Slots:
    """Adaptive probabilities (count,) of 1 / 2, of no bit seen yet."""
    return np.full(count, 1 << FINE_BITS + SEEN_BITS - 1, np.int32)


def new_corrections(rows: int) -> Ints:
    """Tables (rows, buckets) that correct nothing: a mixture's own probability in each bucket."""
    _, squash = logistic_tables()
    steps = np.minimum(np.arange(BUCKETS) * 128, 2 * ENDS - 1)
    return np.tile(squash[steps] << FINE_BITS - 16, (rows, 1))


@compiled_in_place
def code_mixed(mixer: Mixer, bit: int, guess: int) -> int:
    """Code a bit by an outside estimate (a logit) and the mixer's `at` and `rows`; returns it."""
    inputs, sets = mixer.inputs, len(mixer.rows)
    _gather(mixer, guess)
    total = 0
    for number in range(sets):
        total += _mix(mixer, number)
    level = min(max(total // sets, -ENDS), ENDS - 1) + ENDS
    bucket, share, tables = level >> 7, level & 127, min(sets, _TABLES)
    # Half of it is the mixture, half its corrections: 2 or 4 times the mean, to be shifted.
    final = tables * mixer.squash[level]
    for number in range(tables):
        final += seen_at(mixer.corrected, mixer.rows[number], bucket, share)
    bit = code(mixer.bits, bit, min(max(final >> tables, LEAST), ONE - LEAST))
    for number in range(tables):
        correct(mixer.corrected, mixer.rows[number], bucket, share, bit * CERTAIN)
    for number in range(sets):
        row = mixer.rows[number]
        error = (bit * ONE - mixer.squash[mixer.mixtures[number] + ENDS]) * mixer.learning_rate
        for place in range(len(inputs)):
            mixer.weights[row, place] += (inputs[place] * error + (1 << 17)) >> 18
    for place in range(len(mixer.at)):
        learn_bit(mixer.contexts, mixer.at[place], bit * CERTAIN, mixer.rates, mixer.memory)
    return bit


@compiled_in_place
def _gather(mixer: Mixer, guess: int) -> None:
    inputs, last = mixer.inputs, len(mixer.at) + 1
    inputs[0], inputs[last] = guess, BIAS
    for place in range(len(mixer.at)):
        inputs[place + 1] = logit_of(mixer.contexts, mixer.at[place], mixer.stretch)


@compiled_in_place
def _mix(mixer: Mixer, number: int) -> int:
    """The logit that a set of weights makes of the inputs."""
    row, mixed = mixer.rows[number], 0
    for place in range(len(mixer.inputs)):
        mixed += mixer.weights[row, place] * mixer.inputs[place]
    mixer.mixtures[number] = min(max(mixed >> 16, -ENDS), ENDS - 1)
    return int(mixer.mixtures[number])


@inlined
def logit_of(counters: Counters, counter: int, stretch: Numbers) -> int:
    """The logit of an adaptive probability."""
    state = np.int64(counters[np.uint64(counter)])
    return int(stretch[np.uint64(state >> SEEN_BITS + FINE_BITS - 12)])


@inlined
def learn_bit(counters: Counters, counter: int, target: int, rates: Numbers, memory: int) -> None:
    """Move an adaptive probability towards a coded bit; target: the bit times `CERTAIN`."""
    place = np.uint64(counter)  # not counted from the end: numba need not ask whether it is
    state = np.int64(counters[place])
    seen = state & ((1 << SEEN_BITS) - 1)
    step = ((target - (state >> SEEN_BITS)) * rates[np.uint64(seen)]) >> 16
    counters[place] = state + (step << SEEN_BITS) + (1 if seen < memory else 0)


@inlined
def seen_at(corrected: Numbers, row: int, bucket: int, share: int) -> int:
    """How often a bit was 1 at a mixture between two buckets; share: of the second, in 1 / 128."""
    place = np.uint64(row), np.uint64(bucket)
    after = np.uint64(row), np.uint64(bucket + 1)
    left, right = corrected[place], corrected[after]
    return int((left * (128 - share) + right * share) >> 13)


@inlined
def correct(corrected: Numbers, row: int, bucket: int, share: int, target: int) -> None:
    """Let the buckets of `seen_at` learn from a coded bit; target: the bit times `CERTAIN`."""
    place = np.uint64(row), np.uint64(bucket)
    after = np.uint64(row), np.uint64(bucket + 1)
    corrected[place] += ((target - corrected[place]) * (128 - share)) >> 14
    corrected[after] += ((target - corrected[after]) * share) >> 14

"""Coding a bit with several estimates of it, mixed in more than one way: integers only.

An estimate from outside and those of adaptive contexts are mixed in the logistic domain by weights
that are learnt on the way (Mahoney 2005, "Adaptive weighing of context models for lossless data
compression"). There are several sets of weights, each chosen by another property of the bit; the
mean of their mixtures counts, and two tables of what became of such mixtures correct it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.binary import (
    ENDS,
    LEAST,
    ONE,
    BitCoder,
    code,
    learning_rates,
    logistic_tables,
)
from puckbench.compiling import compiled_in_place

Ints = NDArray[np.int64]
Slots = NDArray[np.int32]
_FINE_BITS = 22
"""Adaptive probabilities are multiples of 2**-22."""
_SEEN_BITS = 9
"""Below the probability, in the same number: bits seen so far."""
_CERTAIN = (1 << _FINE_BITS) - 1
_BUCKETS = 33
_BIAS = 77
"""An input of every mixture, in units of the logistic domain."""
_WORD, _CONTEXT = round(0.6 * ONE), round(0.05 * ONE)
"""Weights of the estimate from outside and of a context's, to begin with."""
_PACE = 5
"""How fast weights are learnt."""
_MEMORY = 50
"""A context's probability follows its last so many bits: noise changes with the distance."""


class Blender(NamedTuple):
    """State of a coder: where the bytes are, and what it has learnt.

    contexts: probability of a 1 and number of bits seen of each. weights: (rows, inputs), all sets'
    rows one after the other. corrected: (rows, buckets), probability of a 1 where the mixture was
    so. stretch, squash, rates: tables. at: (contexts of a bit,) which; rows: (sets,) of the
    weights; inputs, mixtures: workspace.
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


def blender(bits: BitCoder, contexts: int, inputs: int, rows: int, sets: int) -> Blender:
    """A coder that has learnt nothing yet.

    contexts: in all. inputs: contexts of a bit. rows: of weights, in all `sets`.
    """
    stretch, squash = logistic_tables()
    weights = np.full((rows, inputs + 2), _CONTEXT, np.int64)
    weights[:, 0], weights[:, -1] = _WORD, 0
    steps = np.minimum(np.arange(_BUCKETS) * 128, 2 * ENDS - 1)
    return Blender(
        bits,
        np.full(contexts, 1 << _FINE_BITS + _SEEN_BITS - 1, np.int32),
        weights,
        np.tile(squash[steps] << _FINE_BITS - 16, (rows, 1)),
        stretch,
        squash,
        learning_rates(),
        np.zeros(inputs, np.int64),
        np.zeros(sets, np.int64),
        np.zeros(inputs + 2, np.int64),
        np.zeros(sets, np.int64),
    )


@compiled_in_place
def code_blended(blender: Blender, bit: int, guess: int) -> int:
    """Code a bit with an estimate (a logit), the contexts `at` and the weights' `rows`; the bit."""
    inputs, sets = blender.inputs, len(blender.rows)
    _gather(blender, guess)
    total = 0
    for number in range(sets):
        total += _mix(blender, number)
    level = min(max(total // sets, -ENDS), ENDS - 1) + ENDS
    chance = blender.squash[level]
    bucket, share = level >> 7, level & 127
    first = _seen(blender, blender.rows[0], bucket, share)
    second = _seen(blender, blender.rows[1], bucket, share)
    final = (2 * chance + first + second) >> 2
    bit = code(blender.bits, bit, min(max(final, LEAST), ONE - LEAST))
    for number in range(2):
        _correct(blender, blender.rows[number], bucket, share, bit * _CERTAIN)
    for number in range(sets):
        row = blender.rows[number]
        error = (bit * ONE - blender.squash[blender.mixtures[number] + ENDS]) * _PACE
        for place in range(len(inputs)):
            blender.weights[row, place] += (inputs[place] * error + (1 << 17)) >> 18
    for place in range(len(blender.at)):
        _learn(blender, blender.at[place], bit * _CERTAIN)
    return bit


@compiled_in_place
def _gather(blender: Blender, guess: int) -> None:
    inputs, last = blender.inputs, len(blender.at) + 1
    inputs[0], inputs[last] = guess, _BIAS
    for place in range(len(blender.at)):
        state = blender.contexts[blender.at[place]]
        inputs[place + 1] = blender.stretch[state >> _SEEN_BITS + _FINE_BITS - 12]


@compiled_in_place
def _mix(blender: Blender, number: int) -> int:
    """The logit that a set of weights makes of the inputs."""
    row, mixed = blender.rows[number], 0
    for place in range(len(blender.inputs)):
        mixed += blender.weights[row, place] * blender.inputs[place]
    blender.mixtures[number] = min(max(mixed >> 16, -ENDS), ENDS - 1)
    return int(blender.mixtures[number])


@compiled_in_place
def _seen(blender: Blender, row: int, bucket: int, share: int) -> int:
    left, right = blender.corrected[row, bucket], blender.corrected[row, bucket + 1]
    return int((left * (128 - share) + right * share) >> 13)


@compiled_in_place
def _correct(blender: Blender, row: int, bucket: int, share: int, target: int) -> None:
    corrected = blender.corrected
    corrected[row, bucket] += ((target - corrected[row, bucket]) * (128 - share)) >> 14
    corrected[row, bucket + 1] += ((target - corrected[row, bucket + 1]) * share) >> 14


@compiled_in_place
def _learn(blender: Blender, context: int, target: int) -> None:
    state = np.int64(blender.contexts[context])
    seen, chance = state & ((1 << _SEEN_BITS) - 1), state >> _SEEN_BITS
    chance += ((target - chance) * blender.rates[seen]) >> 16
    blender.contexts[context] = chance << _SEEN_BITS | min(seen + 1, _MEMORY)

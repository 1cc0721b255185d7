"""Coding a bit with several estimates of it, mixed: integers only, the same on every machine.

An estimate from outside and the adaptive probabilities of some contexts are mixed in the logistic
domain by weights that are learnt on the way (Mahoney 2005, "Adaptive weighing of context models for
lossless data compression"), and a table of what became of such mixtures corrects the result.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.binary import (
    ENDS,
    LEAST,
    ONE,
    SLOWEST,
    BitCoder,
    code,
    learning_rates,
    logistic_tables,
)
from puckbench.compiling import compiled_in_place

Ints = NDArray[np.int64]
_FINE_BITS = 22
"""Adaptive probabilities are multiples of 2**-22."""
_CERTAIN = (1 << _FINE_BITS) - 1
_BUCKETS = 33
_BIAS = 77
"""An input of every mixture, in units of the logistic domain."""


class Mixer(NamedTuple):
    """State of a coder: where the bytes are, and what it has learnt.

    chances, seen: (contexts,) probability of a 1 and number of bits seen. weights: (kinds, inputs),
    of the estimate from outside, of the contexts and of a bias. corrected: (kinds, buckets),
    probability of a 1 where the mixture was so. pace: how fast weights are learnt. stretch, squash,
    rates: tables. at: the contexts of a bit; inputs: workspace.
    """

    bits: BitCoder
    chances: Ints
    seen: Ints
    weights: Ints
    corrected: Ints
    pace: int
    stretch: Ints
    squash: Ints
    rates: Ints
    at: Ints
    inputs: Ints


def mixer(
    bits: BitCoder, contexts: int, kinds: int, inputs: int, weights: tuple[float, float], pace: int
) -> Mixer:
    """A coder that has learnt nothing yet.

    contexts: in all. kinds: of bits, with weights of their own. inputs: contexts of a bit. weights:
    of the estimate from outside and of each context, to begin with.
    """
    stretch, squash = logistic_tables()
    first = np.zeros((kinds, inputs + 2), np.int64)
    first[:, 0], first[:, 1:-1] = (round(weight * ONE) for weight in weights)
    steps = np.minimum(np.arange(_BUCKETS) * 128, 2 * ENDS - 1)
    return Mixer(
        bits,
        np.full(contexts, 1 << _FINE_BITS - 1, np.int64),
        np.zeros(contexts, np.int64),
        first,
        np.tile(squash[steps] << _FINE_BITS - 16, (kinds, 1)),
        pace,
        stretch,
        squash,
        learning_rates(),
        np.zeros(inputs, np.int64),
        np.zeros(inputs + 2, np.int64),
    )


@compiled_in_place
def code_mixed(mixer: Mixer, bit: int, kind: int, guess: int) -> int:
    """Code a bit with an estimate (a logit) and the contexts `mixer.at`; the bit."""
    level = _mixture(mixer, kind, guess)
    chance = mixer.squash[level]
    corrected, bucket, share = mixer.corrected, level >> 7, level & 127
    left, right = corrected[kind, bucket], corrected[kind, bucket + 1]
    seen = (left * (128 - share) + right * share) >> 13
    bit = code(mixer.bits, bit, min(max((chance + seen) >> 1, LEAST), ONE - LEAST))
    target = bit * _CERTAIN
    corrected[kind, bucket] += ((target - left) * (128 - share)) >> 14
    corrected[kind, bucket + 1] += ((target - right) * share) >> 14
    error = (bit * ONE - chance) * mixer.pace
    for place in range(len(mixer.inputs)):
        mixer.weights[kind, place] += (mixer.inputs[place] * error + (1 << 17)) >> 18
    for place in range(len(mixer.at)):
        _learn(mixer, mixer.at[place], target)
    return bit


@compiled_in_place
def _mixture(mixer: Mixer, kind: int, guess: int) -> int:
    """The inputs, filled in, and what they come to: a place in `squash`."""
    inputs, weights, last = mixer.inputs, mixer.weights, len(mixer.at) + 1
    inputs[0], inputs[last] = guess, _BIAS
    mixed = weights[kind, 0] * guess + weights[kind, last] * _BIAS
    for place in range(len(mixer.at)):
        inputs[place + 1] = mixer.stretch[mixer.chances[mixer.at[place]] >> 10]
        mixed += weights[kind, place + 1] * inputs[place + 1]
    return int(min(max(mixed >> 16, -ENDS), ENDS - 1) + ENDS)


@compiled_in_place
def _learn(mixer: Mixer, context: int, target: int) -> None:
    seen = mixer.seen[context]
    mixer.chances[context] += ((target - mixer.chances[context]) * mixer.rates[seen]) >> 16
    if seen < SLOWEST:
        mixer.seen[context] = seen + 1

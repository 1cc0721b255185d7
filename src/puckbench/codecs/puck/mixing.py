"""Logistic mixing of a binary decision's estimates: experts' logits and adaptive contexts.

As `codecs.common.context_mixing`, but with any number of outside estimates (the experts: each
believes in a value and a scale) in place of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.common.binary_coder import (
    ENDS,
    LEAST,
    ONE,
    BitCoder,
    code,
    learning_rates,
    logistic_tables,
)
from puckbench.codecs.common.context_mixing import (
    BIAS,
    CERTAIN,
    correct,
    learn_bit,
    logit_of,
    new_corrections,
    new_counters,
    seen_at,
)
from puckbench.core.compiling import inlined

Ints = NDArray[np.int64]
Words = NDArray[np.int32]


class Mixer(NamedTuple):
    """State of a mixer.

    bits: the arithmetic coder. counters: (contexts,) probability of a 1 and number of bits seen.
    weights: (rows, inputs), inputs are the experts, the contexts and a constant. corrected:
    (rows, buckets). inputs: (inputs,), of which the caller fills the experts. at: (contexts of a
    bit,) its counters. rows: (sets,) its weights' rows. mixtures: (sets,) workspace. pace: learning
    rate at first and in the end, memory of counters, bits coded.
    """

    bits: BitCoder
    counters: Words
    weights: Words
    corrected: Words
    inputs: Words
    at: Ints
    rows: Ints
    mixtures: Ints
    stretch: Words
    squash: Words
    rates: Words
    pace: Ints


def new_mixer(
    bits: BitCoder, experts: int, contexts: int, counters: int, rows: int, sets: int,
    pace: tuple[int, int, int], starts: Sequence[float],
) -> Mixer:  # fmt: skip
    """A mixer in its initial state.

    pace: learning rate at first, in the end, and the memory of counters. starts: initial weights of
    each expert, then of each context.
    """
    stretch, squash = logistic_tables()
    inputs = experts + contexts + 1
    weights = np.zeros((rows, inputs), np.int32)
    weights[:, :-1] = [round(start * ONE) for start in starts]
    return Mixer(
        bits,
        new_counters(counters),
        weights,
        new_corrections(rows).astype(np.int32),
        np.zeros(inputs, np.int32),
        np.zeros(contexts, np.int64),
        np.zeros(sets, np.int64),
        np.zeros(sets, np.int64),
        stretch.astype(np.int32),
        squash.astype(np.int32),
        learning_rates().astype(np.int32),
        np.array([*pace, 0], np.int64),
    )


@inlined
def code_bit(mixer: Mixer, bit: int) -> int:
    """Code a bit by the experts' `inputs` and the mixer's `at` and `rows`; returns it."""
    inputs, at, weights = mixer.inputs, mixer.at, mixer.weights
    contexts, sets, width = len(at), len(mixer.rows), len(inputs)
    first = width - contexts - 1
    for place in range(contexts):
        inputs[first + place] = logit_of(mixer.counters, at[place], mixer.stretch)
    inputs[width - 1] = BIAS
    total = 0
    for number in range(sets):
        row, mixed = mixer.rows[number], 0
        for place in range(width):
            mixed += np.int64(weights[row, place]) * inputs[place]
        mixed = min(max(mixed >> 16, -ENDS), ENDS - 1)
        mixer.mixtures[number] = mixed
        total += mixed
    level = total // sets + ENDS
    bucket, share, own = level >> 7, level & 127, mixer.rows[0]
    seen = seen_at(mixer.corrected, own, bucket, share)
    final = (int(mixer.squash[level]) + seen) >> 1
    bit = code(mixer.bits, bit, min(max(final, LEAST), ONE - LEAST))
    correct(mixer.corrected, own, bucket, share, bit * CERTAIN)
    pace = mixer.pace
    rate = pace[1] + ((pace[0] - pace[1]) * 256) // (256 + (pace[3] >> 3))
    pace[3] += 1
    for number in range(sets):
        row = mixer.rows[number]
        error = (bit * ONE - mixer.squash[mixer.mixtures[number] + ENDS]) * rate
        for place in range(width):
            weights[row, place] += (inputs[place] * error + (1 << 17)) >> 18
    for place in range(contexts):
        learn_bit(mixer.counters, at[place], bit * CERTAIN, mixer.rates, pace[2])
    return bit

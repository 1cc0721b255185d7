"""Logistic mixing of a binary decision's estimates: experts' logits and adaptive contexts.

As `codecs.common.context_mixing`, but with any number of outside estimates (the experts: each
believes in a value and a scale) in place of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
from puckbench.coding.context_mixing import (
    BIAS,
    CERTAIN,
    correct,
    learn_bit,
    logit_of,
    new_corrections,
    new_counters,
    seen_at,
)
from puckbench.coding.integers import dot
from puckbench.coding.intrinsics import add_scaled, lanes_for
from puckbench.core.compiling import inlined

Ints = NDArray[np.int64]
Words = NDArray[np.int32]
Many = tuple[int, ...]


class Mixer(NamedTuple):
    """State of a mixer.

    bits: the arithmetic coder. counters: (contexts,) probability of a 1 and number of bits seen.
    weights: (rows * lanes,), of the experts, the contexts, a constant, and zeros. corrected:
    (rows, buckets). inputs: (lanes,), of which the caller fills the experts. at: (contexts of a
    bit,) its counters. rows: (sets,) its weights' rows. mixtures: (sets,) workspace. pace: learning
    rate at first and in the end, memory of counters, bits coded, learning rate now. experts,
    contexts, sets, lanes: tuples of zeros, as many as there are: lengths of tuples are constants of
    compiled loops, which are unrolled.
    """

    bits: BitCoder
    counters: NDArray[np.uint32]
    weights: Words
    corrected: Words
    inputs: Words
    at: Ints
    rows: Ints
    mixtures: Ints
    stretch: NDArray[np.int16]
    squash: NDArray[np.uint16]
    rates: Words
    pace: Ints
    experts: Many
    contexts: Many
    sets: Many
    lanes: Many


def new_mixer(
    bits: BitCoder, experts: int, contexts: int, counters: int, rows: int, sets: int,
    pace: tuple[int, int, int], starts: Sequence[float],
) -> Mixer:  # fmt: skip
    """A mixer in its initial state.

    pace: learning rate at first, in the end, and the memory of counters. starts: initial weights of
    each expert, then of each context.
    """
    stretch, squash = logistic_tables()
    lanes = lanes_for(experts + contexts + 1)
    weights = np.zeros((rows, len(lanes)), np.int32)
    weights[:, : experts + contexts] = [round(start * ONE) for start in starts]
    inputs = np.zeros(len(lanes), np.int32)
    inputs[experts + contexts] = BIAS
    return Mixer(
        bits,
        new_counters(counters).view(np.uint32),
        weights.ravel(),
        new_corrections(rows).astype(np.int32),
        inputs,
        np.zeros(contexts, np.int64),
        np.zeros(sets, np.int64),
        np.zeros(sets, np.int64),
        stretch.astype(np.int16),
        squash.astype(np.uint16),
        learning_rates().astype(np.int32),
        np.array([*pace, 0, pace[0]], np.int64),
        (0,) * experts,
        (0,) * contexts,
        (0,) * sets,
        lanes,
    )


@inlined
def code_bit(mixer: Mixer, bit: int, node: int, row: int) -> int:
    """Code a bit by the experts' `inputs` and the mixer's `at` and `rows`; returns it.

    node, row: added to all of `at` and all of `rows`.
    """
    inputs, counters, weights = mixer.inputs, mixer.counters, mixer.weights
    experts, sets = len(mixer.experts), len(mixer.sets)
    width = len(mixer.lanes)
    for k in range(len(mixer.contexts)):
        inputs[experts + k] = logit_of(counters, mixer.at[k] + node, mixer.stretch)
    total = 0
    for k in range(sets):
        mixed = dot(weights, (mixer.rows[k] + row) * width, inputs, 0, mixer.lanes) >> 16
        mixed = min(max(mixed, -ENDS), ENDS - 1)
        mixer.mixtures[k] = mixed
        total += mixed
    level = total // sets + ENDS
    bucket, share, own = level >> 7, level & 127, mixer.rows[0] + row
    seen = seen_at(mixer.corrected, own, bucket, share)
    final = (int(mixer.squash[np.uint64(level)]) + seen) >> 1
    bit = code(mixer.bits, bit, min(max(final, LEAST), ONE - LEAST))
    correct(mixer.corrected, own, bucket, share, bit * CERTAIN)
    rate = _rate(mixer.pace)
    for k in range(sets):
        error = (bit * ONE - int(mixer.squash[np.uint64(mixer.mixtures[k] + ENDS)])) * rate
        add_scaled(weights, (mixer.rows[k] + row) * width, inputs, error, 18, mixer.lanes)
    for k in range(len(mixer.contexts)):
        learn_bit(counters, mixer.at[k] + node, bit * CERTAIN, mixer.rates, mixer.pace[2])
    return bit


@inlined
def _rate(pace: Ints) -> int:
    """The learning rate of the next bit; it changes every eight bits."""
    coded = pace[3]
    if coded & 7 == 0:
        pace[4] = pace[1] + ((pace[0] - pace[1]) * 256) // (256 + (coded >> 3))
    pace[3] = coded + 1
    return int(pace[4])

"""Coding of the second ranges of beams in dual return mode, most of which equal the first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import BitCoder, exhausted
from pointkit.coding.context_mixing import Ints, Mixer, MixerOptions, Words, code_bit, new_mixer
from pointkit.compiling import compiled_in_place, inlined
from puck.experts import FINE, Experts, begin, learn, new_experts
from puck.numbers import NODES, code_number, halves
from puck.ranges import PAD

_SAME_ROWS = 8
_FIRST_SCALE = 60 * FINE * 256


class SecondReturnModel(NamedTuple):
    """Adaptive model of second ranges.

    The array `other` holds each laser's last second range that differs from the first range.
    """

    same: Mixer
    value: Mixer
    experts: Experts
    other: Ints
    step: int
    farthest: int


def new_second_return_model(
    bits: BitCoder, lasers: int, step: int, farthest: int
) -> SecondReturnModel:
    """Return an untrained model for ranges up to `farthest` quanta in steps of `step`."""
    same = MixerOptions(
        contexts=3, counters=1024 + lasers * 8 + 640, rows=_SAME_ROWS, weights=[0.4] * 3
    )
    value = MixerOptions(
        experts=4, contexts=2, counters=65 * NODES, rows=NODES, weights=[0.3] * 4 + [0.2] * 2,
        learning_rate=16, final_learning_rate=4,
    )  # fmt: skip
    scales = np.full((4, 1), _FIRST_SCALE, np.int32)
    return SecondReturnModel(
        new_mixer(bits, same),
        new_mixer(bits, value),
        new_experts(scales, len(scales)),
        np.zeros(lasers, np.int64),
        step,
        farthest,
    )


@compiled_in_place
def code_second_returns(
    model: SecondReturnModel, ranges: Words, first: Words, then: Words, then_first: Words,
    nearest: Ints, source: Words, source_first: Words,
) -> bool:  # fmt: skip
    """Encode or decode a turn's second ranges, and return False if the stream ends early.

    Parameters
    ----------
    model
        Adaptive model, which holds the arithmetic encoder or decoder.
    ranges
        Result: second ranges (PAD + columns, lasers) are written from row PAD on.
    first
        First ranges of this turn.
    then, then_first
        Second and first ranges of the previous turn.
    nearest
        For each column, the row of the nearest column in the previous turn, as in
        `ranges.code_ranges`.
    source, source_first
        Second and first ranges before quantisation, which only an encoder reads.
    """
    step = model.step
    for c in range(PAD, len(ranges)):
        for laser in range(ranges.shape[1]):
            t = nearest[c - PAD]
            is_same = 1 if source[c, laser] == source_first[c, laser] else 0
            if _code_same(model, ranges, first, then, then_first, c, laser, t, is_same) == 1:
                ranges[c, laser] = first[c, laser]
                continue
            number = (source[c, laser] + step // 2) // step + 1 if source[c, laser] > 0 else 0
            number = _code_other(model, ranges, first, then, then_first, c, laser, t, number)
            ranges[c, laser] = min(max((number - 1) * step, 1), model.farthest) if number > 0 else 0
            if number > 0:
                model.other[laser] = ranges[c, laser]
        if exhausted(model.same.bits):
            return False
    return True


@inlined
def _differs(ranges: Words, first: Words, row: int, laser: int) -> int:
    return 1 if ranges[row, laser] != first[row, laser] else 0


@inlined
def _code_same(
    model: SecondReturnModel, ranges: Words, first: Words, then: Words, then_first: Words, c: int,
    laser: int, t: int, is_same: int,
) -> int:  # fmt: skip
    west = _differs(ranges, first, c - 1, laser) + 2 * _differs(ranges, first, c - 2, laser)
    below, above, past = 0, 0, 0
    if laser > 0:
        below = _differs(ranges, first, c, laser - 1)
    if laser + 1 < ranges.shape[1]:
        above = _differs(ranges, first, c - 1, laser + 1)
    if t > 0:
        for k in range(3):
            past += _differs(then, then_first, t - 1 + k, laser) << k
    returned = 1 if first[c, laser] > 0 else 0
    jump = min(halves(abs(first[c, laser] - first[c - 1, laser])), 31)
    same, lasers = model.same, ranges.shape[1]
    around = (west * 2 + below) * 2 + above
    same.contexts[0] = (around * 8 + past) * 2 + returned
    same.contexts[1] = 1024 + laser * 8 + returned * 4 + west
    same.contexts[2] = 1024 + lasers * 8 + (jump * 2 + returned) * 2 + below
    same.rows[0] = returned * 4 + min(west, 1) * 2 + below
    return code_bit(same, is_same, 0, 0)


@inlined
def _code_other(
    model: SecondReturnModel, ranges: Words, first: Words, then: Words, then_first: Words, c: int,
    laser: int, t: int, number: int,
) -> int:  # fmt: skip
    """Code a second range that differs from the first, as 1 + its number of steps; 0: no return."""
    means, step = model.experts.means, model.step
    means[0] = FINE * (first[c, laser] + step) if first[c, laser] > 0 else 0
    means[1] = FINE * (model.other[laser] + step) if model.other[laser] > 0 else 0
    means[2], means[3] = 0, 0
    if t > 0 and _differs(then, then_first, t, laser) == 1:
        means[2] = FINE * (then[t, laser] + step)
    if laser > 0 and _differs(ranges, first, c, laser - 1) == 1:
        means[3] = FINE * (ranges[c, laser - 1] + step)
    begin(model.experts, 0)
    m = model.value
    available = (means[1] > 0) + 2 * (means[2] > 0) + 4 * (means[3] > 0) + 8 * (means[0] > 0)
    m.contexts[0], m.contexts[1], m.rows[0] = 0, (1 + available) * NODES, 0
    unit = max(16 // step, 1)
    coded = code_number(m, model.experts, number, 1, unit, step, model.farthest, 1)
    if coded > 0:
        learn(model.experts, 0, FINE * step * coded, 4)
    return coded

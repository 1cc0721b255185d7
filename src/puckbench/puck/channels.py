"""Coding of further images of a turn, of up to 16 bits: signal, near infrared light, flags.

A pixel is coded as binary decisions around a prediction by least squares, as ranges are. The signal
of a return is nearly a function of its range and reflectivity; a model of it, a sum of three
learnt logarithms, estimates the signal.

Variables have the same names as in `ranges`.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from puckbench.coding.binary_coder import BitCoder, exhausted
from puckbench.coding.context_mixing import Ints, Mixer, MixerOptions, Words, code_bit, new_mixer
from puckbench.core.compiling import compiled_in_place, inlined
from puckbench.puck.experts import FINE, Experts, begin, learn, new_experts
from puckbench.puck.least_squares import (
    LeastSquares,
    learn_target,
    new_least_squares,
    predicted,
    solve,
)
from puckbench.puck.numbers import (
    NODES,
    code_number,
    code_unmixed_bit,
    code_unmixed_number,
    halves,
    level_of,
)
from puckbench.puck.ranges import PAD

MAX_VALUE = (1 << 16) - 1
_EXPERTS = 5
_CONTEXTS = 6
_FEATURES = 24
_LEVELS = 20
_SIZES = 36
_CLIP = 480
_LIMIT = 1 << 18
_SLOW = (16, 16, 12, 8)

_LOG_ONE = 4096
"""The logarithm 1 (base 2) of the estimates of signals."""
_BINS = 320


class ChannelModel(NamedTuple):
    zero: Mixer  # of the decision whether a value is 0
    value: Mixer  # of the decisions on other values
    starts: Ints  # first counter of each context of `value`
    experts: Experts
    linear: LeastSquares
    last: Ints  # for each laser: its last value above 0,
    error: Ints  # and the running mean of its errors, in 1 / FINE
    bias: Ints
    memory: Ints  # number of values
    gains: Ints  # (4, 256), logarithms of signals: by reflectivity, laser, range and estimate,
    counts: Ints  # (4, 256), and how often each was learnt
    places: Ints
    estimate: Ints  # the current ones of the four
    logarithms: Words  # tables
    powers: Words
    kind: int
    farthest: int


class ChannelContext(NamedTuple):
    """Values of a turn and what predicts them, (PAD + columns, lasers) each."""

    values: Words
    held: Words  # the laser's last value above 0 up to this column
    errors: Words  # absolute prediction errors, in 1 / FINE
    hints: Words  # estimates from range and reflectivity, in 1 / FINE, or 0
    ranges: Words  # 0 for no return
    signals: Words


def new_channel_model(bits: BitCoder, lasers: int, lean: bool = False, kind: int = 0, farthest: int = MAX_VALUE) -> ChannelModel:
    """Return a new model; a `lean` one has a counter for each decision, without mixing."""
    sizes = np.array([_LEVELS * 4, 100, 100, lasers, _SIZES * 10, _SIZES * _LEVELS]) * NODES
    experts, contexts = (0, 1) if lean else (_EXPERTS, _CONTEXTS)
    if lean:
        sizes = np.array([_LEVELS * 16 * NODES])
    zeros = np.zeros(lasers, np.int64)
    level = np.arange(_LEVELS) + 4
    usual = (1 << level // 2) * (2 + level % 2) * 128
    zero_contexts = 1 if lean else 3
    model = ChannelModel(
        new_mixer(bits, MixerOptions(
            experts=0, contexts=zero_contexts, counters=1024 + lasers * 32 + 1024, rows=32,
            weights=[0.4] * zero_contexts, learning_rate=14, final_learning_rate=3, memory=160,
        )),
        new_mixer(bits, MixerOptions(
            experts=experts, contexts=contexts, counters=int(sizes.sum()),
            rows=NODES * (_LEVELS + _SIZES), weights=[0.2] * (experts + contexts),
            learning_rate=24, final_learning_rate=4, memory=160, sets=1 if lean else 2,
        )),
        np.cumsum(sizes) - sizes,
        new_experts(np.tile(usual, (_EXPERTS, 1)).astype(np.int32), experts),
        new_least_squares(1, _FEATURES),
        zeros, zeros + 8 * FINE, zeros.copy(), np.zeros(1, np.int64),
        np.zeros((5, _BINS), np.int64), np.zeros((5, _BINS), np.int64), np.zeros(4, np.int64), np.zeros(2, np.int64),
        *_tables(), kind, farthest,
    )  # fmt: skip
    if kind == 2 and farthest == MAX_VALUE:
        model.gains[4, 0], model.counts[4, 0] = -int(19.93 * (1 << 20)), 1
    return model


@cache
def _tables() -> tuple[Words, Words]:
    """Return the logarithms of 1 + k / 4096, and 2 ** (k / 4096) in 2 ** -15."""
    k = np.arange(_LOG_ONE) / _LOG_ONE
    logarithms, powers = np.rint(_LOG_ONE * np.log2(1 + k)), np.rint(2**15 * 2**k)
    return logarithms.astype(np.int32), powers.astype(np.int32)


@compiled_in_place
def code_channel(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, nearest: Ints
) -> bool:
    """Encode or decode the values of a turn; return False if the decoded stream ended early.

    A writer reads `image.values` from row PAD on, a reader writes them; both fill `held`,
    `errors` and `hints`. `before` and `nearest` are as in `ranges.code_ranges`.
    """
    values = image.values
    is_lean = len(model.experts.every) == 0
    for c in range(PAD, len(values)):
        t = nearest[c - PAD]
        for laser in range(values.shape[1]):
            hint = _hint(model, image, c, laser)
            image.hints[c, laser] = hint
            is_zero = _code_zero(model, image, before, c, laser, t, is_lean)
            if is_zero == 0:
                _code_value(model, image, before, c, laser, t, hint, is_lean)
                model.last[laser] = values[c, laser]
                if hint > 0:
                    _learn_hint(model, values[c, laser])
            else:
                values[c, laser] = 0
                image.errors[c, laser] = image.errors[c - 1, laser]
            image.held[c, laser] = model.last[laser]
        if exhausted(model.zero.bits):
            return False
    return True


@inlined
def _log2(model: ChannelModel, value: int) -> int:
    whole = (halves(value - 1)) >> 1  # floor(log2(value)), value at least 1
    fraction = ((value << 12) >> whole) - _LOG_ONE
    return whole * _LOG_ONE + int(model.logarithms[np.uint64(fraction)])


@inlined
def _power(model: ChannelModel, logarithm: int) -> int:
    """Return 2 ** logarithm in 1 / FINE, at least 1."""
    logarithm = min(max(logarithm, -3 * _LOG_ONE), 24 * _LOG_ONE - 1)
    whole = logarithm >> 12
    mantissa = int(model.powers[np.uint64(logarithm & (_LOG_ONE - 1))])
    return max((mantissa << (whole + 4)) >> 15 if whole > -4 else 0, 1)


@inlined
def _hint(model: ChannelModel, image: ChannelContext, c: int, laser: int) -> int:
    """Return the estimate of a value from its range and, unless it is one, its signal."""
    distance, signal = int(image.ranges[c, laser]), int(image.signals[c, laser])
    if model.kind == 0 or distance == 0 or (model.kind == 2 and signal == 0):
        return 0
    places = model.places
    distance = _log2(model, distance)
    places[0], places[1] = laser << 8, distance
    total = (-2 * distance << 8) + model.gains[4, 0] + model.gains[0, laser]
    total += _gain(model, 1)
    if model.kind == 2:
        level = _log2(model, signal)
        total += (level + 4 * distance) << 8
        places[2] = level
        total += _gain(model, 2)
        places[3] = min(max(total >> 8, 0), (_BINS - 2) << 8)
        total += _gain(model, 3)
    model.estimate[0] = total
    hint = _power(model, total >> 8)
    model.estimate[1] = hint // FINE
    if model.farthest == MAX_VALUE:
        return max(hint % (FINE << 16), 1)
    return min(hint, FINE * model.farthest)


@inlined
def _gain(model: ChannelModel, k: int) -> int:
    place, share = model.places[k] >> 8, model.places[k] & 255
    gains = model.gains
    return (gains[k, place] * (256 - share) + gains[k, place + 1] * share) >> 8


@inlined
def _learn_hint(model: ChannelModel, value: int) -> None:
    places, gains, counts = model.places, model.gains, model.counts
    # The sum may exceed 16 bits, of which a value has the lowest.
    if model.farthest == MAX_VALUE:
        value += max(model.estimate[1] - value + (1 << 15), 0) >> 16 << 16
    error = (_log2(model, value) << 8) - model.estimate[0]
    if counts[4, 0] == 0:
        counts[4, 0] = 1
        gains[4, 0] = error
        return
    if model.farthest == MAX_VALUE and abs(error) > _LIMIT and model.kind == 2:
        return
    error = min(max(error, -_LIMIT), _LIMIT)
    for k in range(4 if model.kind == 2 else 2):
        place, share = places[k] >> 8, places[k] & 255
        slow = 512 if model.kind == 1 else _SLOW[k]
        counts[k, place] += 256 - share
        counts[k, place + 1] += share
        first = min((counts[k, place] >> 8) + slow // 4, slow)
        second = min((counts[k, place + 1] >> 8) + slow // 4, slow)
        gains[k, place] += (error * (256 - share)) // (first << 8)
        gains[k, place + 1] += (error * share) // (second << 8)


@inlined
def _code_zero(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    is_lean: bool,
) -> int:  # fmt: skip
    values, zero = image.values, model.zero
    returned = 1 if image.ranges[c, laser] > 0 else 0
    west = 1 if values[c - 1, laser] == 0 else 0
    west2 = 1 if values[c - 2, laser] == 0 else 0
    below, above, then = 0, 0, 2
    if laser > 0:
        below = 1 if values[c, laser - 1] == 0 else 0
    if laser + 1 < values.shape[1]:
        above = 1 if values[c - 1, laser + 1] == 0 else 0
    if t > 0:
        then = 1 if before.values[t, laser] == 0 else 0
    bit = 1 if values[c, laser] == 0 else 0
    state = ((west * 2 + west2) * 2 + below) * 2 + above
    first = (state * 3 + then) * 2 + returned
    if is_lean:
        return code_unmixed_bit(zero, first, bit)
    size = min(halves(model.last[laser]), 31)
    zero.contexts[0] = first
    zero.contexts[1] = 1024 + laser * 32 + (west * 3 + then) * 2 + returned
    zero.contexts[2] = 1024 + values.shape[1] * 32 + (size * 8 + state // 2) * 2 + returned
    zero.rows[0] = (west * 2 + below) * 2 + returned
    return code_bit(zero, bit, 0, 0)


@inlined
def _code_value(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    hint: int, is_lean: bool,
) -> None:  # fmt: skip
    values, held = image.values, image.held
    west, below, then = int(model.last[laser]), 0, 0
    if laser > 0:
        below = int(values[c, laser - 1])
    if t > 0:
        then = int(before.values[t, laser])
    base = FINE * west
    if model.kind == 2 and hint > 0:
        base = hint
    elif hint > 0 and west > 0 and image.hints[c - 1, laser] > 0:
        base = min(max(base * hint // int(image.hints[c - 1, laser]), base >> 2), base << 2)
        base = min(base, MAX_VALUE * FINE)
    elif base == 0:
        base = FINE * below if below > 0 else FINE * then
    shift = max((halves(base) >> 1) - 7, 0)
    _write_features(model, image, before, c, laser, t, base, shift)
    first = predicted(model.linear, 0)
    biased = first + (int(model.bias[laser]) >> 8)
    mean = max(base + (biased << shift), FINE)
    mean = min(mean, FINE * model.farthest)
    size = min(halves(mean), _SIZES - 1)
    level = _activity(model, image, before, c, laser, t, size)
    known = (1 if then > 0 else 0) + (2 if hint > 0 else 0)
    scales = model.experts.scales
    situation = level
    unit = max(int(scales[0, situation] >> 8) * 4 // 64, 1)
    centre = max((mean + FINE // 2) // FINE, 1)
    if is_lean:
        near = _near(then, centre, unit) if then > 0 else _near(below, centre, unit)
        start = (level * 16 + near) * NODES
        value = code_unmixed_number(
            model.value, model.experts, start, int(values[c, laser]), centre, unit, 1, model.farthest
        )
        wrong = min(abs(FINE * value - mean), 4000) * 256
        scales[0, situation] += (wrong - scales[0, situation]) >> 6
    else:
        means, at, starts = model.experts.means, model.value.contexts, model.starts
        x = model.linear.features
        near_west, near_below = base + (x[0] << shift), base + (x[4] << shift)
        means[0], means[1] = mean, max(near_west, 1)
        means[2] = hint if model.kind == 2 else FINE * west
        means[3], means[4] = FINE * then, max(near_below, 1) if below > 0 else 0
        begin(model.experts, situation)
        above = 0
        if laser + 1 < values.shape[1]:
            above = int(values[c - 1, laser + 1])
        at[0] = starts[0] + (level * 4 + known) * NODES
        at[1] = starts[1] + (_near(near_below // FINE, centre, unit) * 10 + _near(above, centre, unit)) * NODES
        at[2] = starts[2] + (_near(then, centre, unit) * 10 + _near(near_west // FINE, centre, unit)) * NODES
        at[3] = starts[3] + laser * NODES
        at[4] = starts[4] + (size * 10 + _near(near_west // FINE, centre, unit)) * NODES
        at[5] = starts[5] + (size * _LEVELS + level) * NODES
        model.value.rows[0] = level * NODES
        model.value.rows[1] = (_LEVELS + size) * NODES
        value = code_number(
            model.value, model.experts, int(values[c, laser]), centre, unit, 1, model.farthest
        )
        learn(model.experts, situation, FINE * value, 6)
    value = min(max(value, 1), model.farthest)
    values[c, laser] = value
    wrong = abs(FINE * value - mean)
    image.errors[c, laser] = min(wrong, 1 << 20)
    model.error[laser] += (min(wrong, 1 << 20) - model.error[laser]) >> 2
    target = (FINE * value - base) >> shift
    if abs(target) < 2 * _CLIP:
        model.bias[laser] += (((target - first) << 8) - int(model.bias[laser])) >> 6
        learn_target(model.linear, 0, target, 0, 12)
        model.memory[0] += 1
        if model.memory[0] % 16 == 0:
            solve(model.linear, 0)


@inlined
def _near(value: int, centre: int, unit: int) -> int:
    return level_of(value - centre, unit) if value > 0 else 9


@inlined
def _activity(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    size: int,
) -> int:  # fmt: skip
    own, errors = int(model.error[laser]), image.errors
    total = 2 * own
    total += errors[c, laser - 1] if laser > 0 else own
    total += errors[c - 1, laser + 1] if laser + 1 < errors.shape[1] else own
    if t > 0:
        total += 2 * before.errors[t, laser] + before.errors[t + 1, laser]
        total += before.errors[t - 1, laser]
    else:
        total += 4 * own
    return min(max(halves(total >> 3) - 6, 0), _LEVELS - 1)


@inlined
def _difference(later: int, base: int, shift: int) -> int:
    if later == 0:
        return 0
    return min(max((FINE * later - base) >> shift, -_CLIP), _CLIP)


@inlined
def _write_features(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    base: int, shift: int,
) -> None:  # fmt: skip
    x, held, values, hints = model.linear.features, image.held, image.values, image.hints
    for k in range(_FEATURES):
        x[k] = 0
    hint = int(hints[c, laser])
    for k in range(4):
        x[k] = _relative(image, c, laser, c - 1 - k, laser, base, shift, hint, model.kind)
    if laser > 0:
        x[4] = _relative(image, c, laser, c, laser - 1, base, shift, hint, model.kind)
        x[5] = _relative(image, c, laser, c - 1, laser - 1, base, shift, hint, model.kind)
    if laser > 1:
        x[6] = _relative(image, c, laser, c, laser - 2, base, shift, hint, model.kind)
    if laser + 1 < values.shape[1]:
        x[7] = _relative(image, c, laser, c - 1, laser + 1, base, shift, hint, model.kind)
    x[16] = _relative(image, c, laser, c - 5, laser, base, shift, hint, model.kind)
    x[17] = _relative(image, c, laser, c - 6, laser, base, shift, hint, model.kind)
    if laser > 0:
        x[18] = _relative(image, c, laser, c - 2, laser - 1, base, shift, hint, model.kind)
    if laser > 1:
        x[19] = _relative(image, c, laser, c - 1, laser - 2, base, shift, hint, model.kind)
    if laser > 2:
        x[20] = _relative(image, c, laser, c, laser - 3, base, shift, hint, model.kind)
    if laser + 1 < values.shape[1]:
        x[21] = _relative(image, c, laser, c - 2, laser + 1, base, shift, hint, model.kind)
    if laser + 2 < values.shape[1]:
        x[22] = _relative(image, c, laser, c - 1, laser + 2, base, shift, hint, model.kind)
    if model.kind == 0:
        signal, other = int(image.signals[c, laser]), int(image.signals[c - 1, laser])
        if signal > 0 and other > 0:
            x[23] = min(max(((signal - other) * base // other) >> shift, -_CLIP), _CLIP)
    if t > 0:
        then = before.values
        for k in range(3):
            x[8 + k] = _difference(then[t - 1 + k, laser], base, shift)
        if laser > 0:
            x[11] = _difference(then[t, laser - 1], base, shift)
    x[12] = FINE * 2
    if model.kind == 1:
        x[13] = _difference(values[c - 1, laser], base, shift)
        x[14] = _difference(values[c - 2, laser], base, shift)
        if laser > 0:
            x[15] = _difference(values[c, laser - 1], base, shift)


@inlined
def _relative(
    image: ChannelContext, c: int, laser: int, row: int, other: int, base: int, shift: int,
    hint: int, kind: int,
) -> int:  # fmt: skip
    """Return how far another pixel is from its estimate, or from the base if there is none."""
    value = FINE * image.values[row, other]
    if value == 0:
        return 0
    if hint > 0:
        there = int(image.hints[row, other])
        if there == 0:
            return 0
        if kind == 2:
            value = base + (value - there) * (base >> 4) // max(there >> 4, 1)
        else:
            value = value * hint // there
    return min(max((value - base) >> shift, -_CLIP), _CLIP)

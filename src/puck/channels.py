"""Coding of a turn's images with up to 16 bits: signal, reflectivity, near infrared, flags.

Like ranges, pixels are coded as binary decisions around least squares predictions. A return's
reflectivity is nearly a function of the range and signal, and is estimated by learnt tables
(`gains`). Variables are named as in `ranges`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import BitCoder, exhausted
from pointkit.coding.context_mixing import Ints, Mixer, MixerOptions, Words, code_bit, new_mixer
from pointkit.compiling import compiled_in_place, inlined
from puck.experts import FINE, Experts, begin, first_scales, learn, new_experts
from puck.gains import Gains, estimated, learn_estimate, new_gains
from puck.least_squares import LeastSquares, learn_target, new_least_squares, predicted, solve
from puck.numbers import NODES, activity, code_number, halves, level_of_value
from puck.options import Effort
from puck.ranges import PAD

_EXPERTS, _CONTEXTS, _ZERO_CONTEXTS = 5, 6, 3
_FEATURES_OF_NORMAL, _FEATURES_OF_THOROUGH = 13, 20
_LEVELS = 20
"""Number of levels of activity, the mean prediction error around a pixel."""
_SIZES = 36
"""Number of levels of predicted values."""
_CLIP = 480
"""Limit of features, to which larger differences are clipped."""
_MOST_ERROR = 1 << 20
_NOISE = 8
"""Mean error from which the values of an image are mostly noise, in effort `normal`."""


class ChannelModel(NamedTuple):
    zero: Mixer  # of the decision whether a value is 0
    value: Mixer  # of the decisions on other values
    starts: Ints  # first counter of each context of `value`, and of `code_number`
    experts: Experts
    linear: LeastSquares
    last: Ints  # for each laser: its last value above 0,
    error: Ints  # the running means of its errors' sizes, in 1 / FINE,
    bias: Ints  # and of its signed errors, in shifted units / 256
    memory: Ints  # number of values
    gains: Gains
    has_signals: int  # 1 for reflectivities, which depend on ranges and signals
    farthest: int  # largest value


class ChannelContext(NamedTuple):
    values: Words
    errors: Words  # absolute prediction errors, in 1 / FINE
    estimates: Words  # from range and signal, in 1 / FINE, or 0
    ranges: Words  # 0 for no return
    signals: Words


def new_channel_model(
    bits: BitCoder, lasers: int, effort: Effort, farthest: int, *, has_signals: bool
) -> ChannelModel:
    """Return a model for pixels with values up to `farthest`, before any pixel was coded."""
    sizes = np.array([_LEVELS * 4, 100, 100, lasers, _SIZES * 10, _SIZES * _LEVELS, 1]) * NODES
    features = _FEATURES_OF_THOROUGH if effort == "thorough" else _FEATURES_OF_NORMAL
    zeros = np.zeros(lasers, np.int64)
    return ChannelModel(
        new_mixer(bits, MixerOptions(
            contexts=_ZERO_CONTEXTS, counters=1024 + lasers * 32 + 512, rows=8,
            weights=[0.4] * _ZERO_CONTEXTS,
        )),
        new_mixer(bits, MixerOptions(
            experts=_EXPERTS, contexts=_CONTEXTS, counters=int(sizes.sum()),
            rows=NODES * (_LEVELS + _SIZES), weights=[0.2] * (_EXPERTS + _CONTEXTS),
            learning_rate=24, final_learning_rate=6, sets=2,
        )),
        np.cumsum(sizes) - sizes,
        new_experts(np.tile(first_scales(_LEVELS, 4), (_EXPERTS, 1)), _EXPERTS),
        new_least_squares(1, features),
        zeros, zeros + 8 * FINE, zeros.copy(), np.zeros(1, np.int64),
        new_gains(lasers, farthest), int(has_signals), farthest,
    )  # fmt: skip


@compiled_in_place
def code_channel(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, nearest: Ints
) -> bool:
    """Encode or decode an image of a turn, and return False if the stream that is decoded ended
    early.

    An encoder reads `image.values` from row PAD on, and a decoder writes them; both write the
    arrays `errors` and `estimates` of `image`. The arguments `before` and `nearest` are those of
    `ranges.code_ranges`.
    """
    values = image.values
    for c in range(PAD, len(values)):
        t = nearest[c - PAD]
        for laser in range(values.shape[1]):
            estimate = 0
            if model.has_signals == 1:
                distance, signal = int(image.ranges[c, laser]), int(image.signals[c, laser])
                estimate = estimated(model.gains, distance, signal, laser)
            image.estimates[c, laser] = estimate
            if _code_zero(model, image, before, c, laser, t) == 1:
                values[c, laser] = 0
                image.errors[c, laser] = image.errors[c - 1, laser]
            else:
                _code_value(model, image, before, c, laser, t, estimate)
                model.last[laser] = values[c, laser]
                if estimate > 0:
                    learn_estimate(model.gains, values[c, laser])
        if exhausted(model.zero.bits):
            return False
    return True


@inlined
def _code_zero(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int
) -> int:
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
    size = min(halves(model.last[laser]), 31)
    zero.contexts[0] = first
    zero.contexts[1] = 1024 + laser * 32 + (west * 3 + then) * 2 + returned
    zero.contexts[2] = 1024 + values.shape[1] * 32 + (size * 8 + state // 2) * 2 + returned
    zero.rows[0] = (west * 2 + below) * 2 + returned
    return code_bit(zero, bit, 0, 0)


@inlined
def _code_value(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    estimate: int,
) -> None:  # fmt: skip
    values, scales = image.values, model.experts.scales
    base = _base(model, image, before, c, laser, t, estimate)
    shift = max((halves(base) >> 1) - 7, 0)
    _write_features(model, image, before, c, laser, t, base, shift)
    first = predicted(model.linear, 0)
    mean = base + ((first + (int(model.bias[laser]) >> 8)) << shift)
    mean = min(max(mean, FINE), FINE * model.farthest)
    error = int(model.error[laser])
    level = activity(error, image.errors, before.errors, c, laser, t, _LEVELS)
    jumps = _jumps(image.ranges, c, laser)
    level = min(level + 2 * jumps, _LEVELS - 1)
    unit = max(int(scales[0, level] >> 8) * 4 // 64, 1)
    centre = (mean + FINE // 2) // FINE
    value = int(values[c, laser])
    _write_contexts(model, image, before, c, laser, t, base, shift, mean, level, jumps, unit)
    is_noise = unit >= _NOISE and model.has_signals == 0
    smooth = unit if is_noise else max(unit >> 1, 1)
    if len(model.linear.every) > _FEATURES_OF_NORMAL:
        smooth = max(unit >> 2, 1)
    value = code_number(
        model.value, model.experts, value, centre, unit, 1, model.farthest, smooth, model.starts[6]
    )
    learn(model.experts, level, FINE * value, 7)
    value = min(max(value, 1), model.farthest)
    values[c, laser] = value
    wrong = min(abs(FINE * value - mean), _MOST_ERROR)
    image.errors[c, laser] = wrong
    model.error[laser] += (wrong - model.error[laser]) >> 2
    target = (FINE * value - base) >> shift
    if abs(target) < 2 * _CLIP:
        model.bias[laser] += (((target - first) << 8) - int(model.bias[laser])) >> 6
        model.memory[0] += 1
        learn_target(model.linear, 0, target, 0, 11)
        if model.memory[0] & 15 == 0:
            solve(model.linear, 0)


@inlined
def _jumps(ranges: Words, c: int, laser: int) -> int:
    """Return 1 if the range differs from the last column's by more than 1 / 128, otherwise 0."""
    here, west = int(ranges[c, laser]), int(ranges[c - 1, laser])
    return 1 if abs(here - west) << 7 > here else 0


@inlined
def _base(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    estimate: int,
) -> int:  # fmt: skip
    """Return the base in units of 1 / FINE; features are other values minus the base."""
    base = FINE * int(model.last[laser])
    if estimate > 0:
        return estimate
    if base == 0 and laser > 0:
        base = FINE * int(image.values[c, laser - 1])
    if base == 0 and t > 0:
        base = FINE * int(before.values[t, laser])
    return base


@inlined
def _write_contexts(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    base: int, shift: int, mean: int, level: int, jumps: int, unit: int,
) -> None:  # fmt: skip
    values, at, starts = image.values, model.value.contexts, model.starts
    means, x = model.experts.means, model.linear.features
    estimate = int(image.estimates[c, laser])
    then = int(before.values[t, laser]) if t > 0 else 0
    above = int(values[c - 1, laser + 1]) if laser + 1 < values.shape[1] else 0
    west, below = base + (x[0] << shift), base + (x[4] << shift)
    has_below = laser > 0 and values[c, laser - 1] > 0
    means[0], means[1] = mean, max(west, 1)
    means[2] = estimate if model.has_signals == 1 else FINE * int(model.last[laser])
    means[3], means[4] = FINE * then, max(below, 1) if has_below else 0
    begin(model.experts, level)
    centre = (mean + FINE // 2) // FINE
    size = min(halves(mean), _SIZES - 1)
    near_west = level_of_value(west // FINE, centre, unit)
    state = (1 if then > 0 else 0) + 2 * jumps
    if model.has_signals == 1:
        state = (1 if then > 0 else 0) + (2 if estimate > 0 else 0)
    at[0] = starts[0] + (level * 4 + state) * NODES
    at[1] = starts[1]
    at[1] += (
        level_of_value(below // FINE, centre, unit) * 10 + level_of_value(above, centre, unit)
    ) * NODES
    at[2] = starts[2] + (level_of_value(then, centre, unit) * 10 + near_west) * NODES
    at[3] = starts[3] + laser * NODES
    at[4] = starts[4] + (size * 10 + near_west) * NODES
    at[5] = starts[5] + (size * _LEVELS + level) * NODES
    model.value.rows[0] = level * NODES
    model.value.rows[1] = (_LEVELS + size) * NODES


@inlined
def _write_features(
    model: ChannelModel, image: ChannelContext, before: ChannelContext, c: int, laser: int, t: int,
    base: int, shift: int,
) -> None:  # fmt: skip
    x = model.linear.features
    for k in range(len(model.linear.every)):
        x[k] = 0
    for k in range(4):
        x[k] = _change(model, image, c, laser, c - 1 - k, laser, base, shift)
    if laser > 0:
        x[4] = _change(model, image, c, laser, c, laser - 1, base, shift)
        x[5] = _change(model, image, c, laser, c - 1, laser - 1, base, shift)
    if laser > 1:
        x[6] = _change(model, image, c, laser, c, laser - 2, base, shift)
    if laser + 1 < image.values.shape[1]:
        x[7] = _change(model, image, c, laser, c - 1, laser + 1, base, shift)
    if t > 0:
        then = before.values
        for k in range(3):
            x[8 + k] = _difference(then[t - 1 + k, laser], base, shift)
        if laser > 0:
            x[11] = _difference(then[t, laser - 1], base, shift)
    x[12] = 2 * FINE
    if len(model.linear.every) > _FEATURES_OF_NORMAL:
        _write_more_features(model, image, c, laser, base, shift)


@inlined
def _write_more_features(
    model: ChannelModel, image: ChannelContext, c: int, laser: int, base: int, shift: int
) -> None:
    x, lasers = model.linear.features, image.values.shape[1]
    x[13] = _change(model, image, c, laser, c - 5, laser, base, shift)
    x[14] = _change(model, image, c, laser, c - 6, laser, base, shift)
    if laser > 0:
        x[15] = _change(model, image, c, laser, c - 2, laser - 1, base, shift)
    if laser > 1:
        x[16] = _change(model, image, c, laser, c - 1, laser - 2, base, shift)
    if laser > 2:
        x[17] = _change(model, image, c, laser, c, laser - 3, base, shift)
    if laser + 1 < lasers:
        x[18] = _change(model, image, c, laser, c - 2, laser + 1, base, shift)
    if laser + 2 < lasers:
        x[19] = _change(model, image, c, laser, c - 1, laser + 2, base, shift)


@inlined
def _difference(later: int, base: int, shift: int) -> int:
    if later == 0:
        return 0
    return min(max((FINE * int(later) - base) >> shift, -_CLIP), _CLIP)


@inlined
def _change(
    model: ChannelModel, image: ChannelContext, c: int, laser: int, row: int, other: int,
    base: int, shift: int,
) -> int:  # fmt: skip
    """Return another pixel minus the base; with estimates, the pixel's error scaled to the base."""
    value, estimate = FINE * int(image.values[row, other]), int(image.estimates[c, laser])
    if value == 0:
        return 0
    if estimate > 0:
        there = int(image.estimates[row, other])
        if there == 0:
            return 0
        value = base + (value - there) * (base >> 4) // max(there >> 4, 1)
    return min(max((value - base) >> shift, -_CLIP), _CLIP)

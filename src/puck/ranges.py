"""Coding of the ranges of a turn (revolution): whether each firing has a return, and its range.

Firings are coded column by column, from the lowest laser to the highest. Ranges are predicted by
adaptive least squares, and coded as binary decisions around the predictions. Lossy coding quantises
a range to the nearest multiple of the step, or to the adjacent multiple towards the prediction if
lambda times the saved rate exceeds the increase of the squared error.

In arrays, c is the index of the current column, and t is that of the nearest column of the previous
turn, or 0 if there is none. "West" is the same laser one column earlier; "below" and "above" are
the neighbouring lasers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import BitCoder, exhausted
from pointkit.coding.context_mixing import Ints, Mixer, MixerOptions, Words, code_bit, new_mixer
from pointkit.compiling import compiled_in_place, inlined
from puck.experts import FINE, Experts, begin, first_scales, learn, new_experts
from puck.least_squares import LeastSquares, learn_target, new_least_squares, predicted, solve
from puck.numbers import (
    NODES,
    activity,
    code_number,
    code_unmixed_bit,
    halves,
    in_steps,
    level_of,
    level_of_value,
)
from puck.options import Effort

PAD = 8
"""Array rows before an image's first column, which hold the previous turn's last columns."""
_LEVELS = 16
"""Number of levels of activity, the mean prediction error around a firing."""
_SITUATIONS = 4 * _LEVELS
_JUMP = 24
"""A larger difference between columns, in range quanta, is taken for a change of surface."""
_FIRST_ERROR = 3 * FINE
_ALL_LEARNT = 1000
"""Number of returns after which effort `fast` updates its prediction at every second return only,
to save time."""


class RangeContext(NamedTuple):
    """Ranges of a turn, and values from which later ranges are predicted.

    All arrays have the shape (PAD + columns, lasers).
    """

    ranges: Words  # 0 for no return
    smooth: Words  # ranges, in 1 / FINE, moved part of the way to their predictions
    errors: Words  # absolute prediction errors, in 1 / FINE
    held: Words  # range of the laser's last return up to this column


class RangeModel(NamedTuple):
    mask: Mixer  # of the decision whether a firing returned
    value: Mixer  # of the decisions on its range
    starts: Ints  # first counter of each context of `value`, and of `mask`
    mask_starts: Ints
    experts: Experts
    linear: LeastSquares
    last: Ints  # for each laser: its last range,
    other: Ints  # its range on the surface before the last jump,
    gap: Ints  # columns since it began or ceased to return,
    error: Ints  # the running mean of its errors
    memory: Ints  # the last signed error, the number of returns
    parameters: Ints  # step, lambda, number of predictors, returns between solver updates, and
    # the largest range


class ModelSize(NamedTuple):
    """Sizes of a model, which uses only the first of all features, experts and contexts."""

    features: int
    experts: int
    contexts: int
    sets: int
    mask_contexts: int
    predictors: int
    solver_interval: int


_MODEL_SIZES: dict[Effort, ModelSize] = {
    "fast": ModelSize(10, 0, 1, 1, 1, 1, 32),
    "normal": ModelSize(10, 4, 3, 1, 3, 1, 16),
    "thorough": ModelSize(22, 9, 8, 3, 6, 9, 8),
}
_EXPERTS_OF_STEPS = 6
"""Number of experts of effort `normal` for ranges in steps of several quanta."""
_EXPERT_WEIGHTS = (0.18, 0.2, 0.16, 0.16, 0.16, 0.1, 0.15, 0.2, 0.22)
_CONTEXT_WEIGHTS = (0.15, 0.2, 0.12, 0.13, 0.05, 0.16, 0.1, 0.15)
_MASK_WEIGHTS = (0.3, 0.16, 0.08, 0.15, 0.14, 0.3)
"""Initial weights, close to those after coding a recording of an HDL-32E."""
_COMMON_FEATURES = 10
"""Number of neighbouring ranges from which efforts `fast` and `normal` predict a range."""


def model_size(effort: Effort, step: int) -> ModelSize:
    """Return the sizes of the model of ranges for an effort and a quantisation step.

    The step is in the sensor's units of range, and 1 without loss.

    With effort `normal`, two more experts save 1 to 3 % of the bits of coarse ranges, and cost bits
    of exact ones.
    """
    size = _MODEL_SIZES[effort]
    has_more = effort == "normal" and step > 1
    return size._replace(experts=_EXPERTS_OF_STEPS) if has_more else size


def new_range_model(
    bits: BitCoder, lasers: int, size: ModelSize, step: int, lmbda: int, farthest: int
) -> RangeModel:
    """Return an untrained model for ranges up to `farthest` quanta in steps of `step`."""
    sizes = np.array([100, _SITUATIONS, 90, 90, 100, 90, lasers, 100]) * NODES
    mask_sizes = np.array([2304, 216 * lasers, 2592, 1296, 3264, 64 * lasers])
    first_weights = [*_EXPERT_WEIGHTS[: size.experts], *_CONTEXT_WEIGHTS[: size.contexts]]
    zeros = np.zeros(lasers, np.int64)
    return RangeModel(
        new_mixer(bits, MixerOptions(
            contexts=size.mask_contexts, counters=int(mask_sizes.sum()), rows=64 + lasers,
            weights=_MASK_WEIGHTS[: size.mask_contexts], learning_rate=24, final_learning_rate=5,
            sets=min(size.sets, 2),
        )),
        new_mixer(bits, MixerOptions(
            experts=size.experts, contexts=size.contexts, counters=int(sizes.sum()),
            rows=NODES * (1 + _LEVELS + 4), weights=first_weights, learning_rate=24,
            final_learning_rate=4, sets=size.sets,
        )),
        np.cumsum(sizes) - sizes,
        np.cumsum(mask_sizes) - mask_sizes,
        new_experts(_first_scales(size.experts), size.experts),
        new_least_squares(size.predictors, size.features),
        zeros, zeros.copy(), zeros.copy(), zeros + _FIRST_ERROR,
        np.zeros(2, np.int64),
        np.array([step, lmbda, size.predictors, size.solver_interval, farthest], np.int64),
    )  # fmt: skip


def _first_scales(experts: int) -> Words:
    times = np.array([1, 1.2, 1.4, 6, 6, 6, 1.4, 1.4, 1])[: max(experts, 1), None]
    scales: Words = np.rint(np.repeat(first_scales(_LEVELS, 6), 4) * times).astype(np.int32)
    return scales


@compiled_in_place
def code_ranges(
    model: RangeModel, image: RangeContext, before: RangeContext, nearest: Ints, source: Words
) -> bool:
    """Encode or decode the ranges of a turn, and return False if the stream ends early.

    Parameters
    ----------
    model
        Adaptive model, which holds the arithmetic encoder or decoder.
    image
        Result: the ranges of this turn, and values computed from them, are written from row PAD on.
    before
        The previous turn, followed by PAD empty rows.
    nearest
        For each column, the row in `before` of the column with the nearest azimuth, or 0 if none is
        near.
    source
        Ranges (PAD + columns, lasers) to encode. A decoder ignores them.
    """
    for column in range(PAD, len(image.ranges)):
        t = nearest[column - PAD]
        for laser in range(image.ranges.shape[1]):
            if len(model.experts.every) == 0:
                exists = _code_mask_unmixed(model, image, before, column, laser, t, source)
            else:
                exists = _code_mask(model, image, before, column, laser, t, source)
            if exists == 1:
                _code_range(model, image, before, column, laser, t, source)
            else:
                image.ranges[column, laser] = 0
                image.smooth[column, laser] = 0
                image.errors[column, laser] = image.errors[column - 1, laser]
                image.held[column, laser] = model.last[laser]
        if exhausted(model.mask.bits):
            return False
    return True


@inlined
def _is(ranges: Words, row: int, laser: int) -> int:
    return 1 if ranges[row, laser] > 0 else 0


@inlined
def _code_mask(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
    source: Words,
) -> int:  # fmt: skip
    ranges, mask, starts = image.ranges, model.mask, model.mask_starts
    lasers = ranges.shape[1]
    west, west2 = _is(ranges, c - 1, laser), _is(ranges, c - 2, laser)
    history = west + 2 * west2 + 4 * _is(ranges, c - 3, laser)
    below, below1, below_two = 2, 0, 0
    if laser > 0:
        below = _is(ranges, c, laser - 1)
        below1 = _is(ranges, c - 1, laser - 1)
    if laser > 1:
        below_two = _is(ranges, c, laser - 2)
    above, above2 = 0, 0
    if laser + 1 < lasers:
        above, above2 = _is(ranges, c - 1, laser + 1), _is(ranges, c - 2, laser + 1)
    then_here, then_east, then_west = 2, 2, 2
    then_east2, then_west2, then_below, then_level = 0, 0, 0, 0
    if t > 0:
        then = before.ranges
        then_here = _is(then, t, laser)
        then_east, then_west = _is(then, t + 1, laser), _is(then, t - 1, laser)
        then_east2, then_west2 = _is(then, t + 2, laser), _is(then, t - 2, laser)
        then_level = min(halves(then[t, laser]) >> 1, 16)
        if laser > 0:
            then_below = _is(then, t, laser - 1)
    at, count = mask.contexts, len(mask.sizes.contexts)
    neighbours = (
        (((history * 2 + _is(ranges, c - 4, laser)) * 3 + below) * 2 + below1) * 2 + below_two
    ) * 2
    at[0] = starts[0] + ((neighbours + above) * 2 + above2) * 3 + then_here
    at[1] = starts[1] + laser * 216 + history * 27 + then_here * 9 + then_east * 3 + then_west
    then_bits = (((then_here * 3 + then_east) * 3 + then_west) * 2 + then_east2) * 2 + then_west2
    at[2] = starts[2] + ((then_bits * 3 + below) * 2 + then_below) * 2 + west
    if count > 3:
        at[3] = starts[3] + (((west * 3 + below) * 2 + below1) * 2 + above) * 3 + then_here
        at[4] = (
            starts[4]
            + ((min(halves(model.last[laser]), 31) * 17 + then_level) * 2 + west) * 3
            + then_here
        )
        at[5] = starts[5] + (laser * 16 + min(model.gap[laser], 15)) * 4 + west * 2 + (below & 1)
    mask.rows[0] = ((west * 3 + below) * 3 + then_here) * 2 + west2
    if len(mask.sizes.sets) > 1:
        mask.rows[1] = 64 + laser
    exists = code_bit(mask, 1 if source[c, laser] > 0 else 0, 0, 0)
    model.gap[laser] = model.gap[laser] + 1 if exists == west else 0
    return exists


@inlined
def _code_range(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
    source: Words,
) -> None:  # fmt: skip
    base, first, level, has_previous, situation = _predict(model, image, before, c, laser, t)
    mean, group, start = FINE * base + 4 * first, 0, -1
    step, farthest = model.parameters[0], model.parameters[4]
    index, centre, unit = _quantise(model, source[c, laser], mean, situation)
    if len(model.experts.every) == 0:
        then = 9
        if has_previous == 1:
            then = level_of(before.smooth[t, laser] - mean, FINE * unit * step)
        start = (then * _LEVELS + level) * NODES
    else:
        if model.parameters[2] > 1:
            group = 1 + 2 * min(max(level - 2, 0) // 3, 3) + has_previous
        _write_experts(model, image, before, c, laser, t, base, mean, group)
        begin(model.experts, situation)
        _write_contexts(model, image, before, c, laser, t, base, situation, mean)
    smooth = 1
    if len(model.experts.every) < _EXPERTS_OF_STEPS:
        smooth = max(unit >> (0 if len(model.experts.every) == 0 else 2), 1)
    index = code_number(
        model.value, model.experts, index, centre, unit, step, farthest, smooth, start
    )
    value = min(max(index * step, 1), farthest)
    if len(model.experts.every) == 0:
        wrong = min(abs(FINE * value - mean), 4000) * 256
        model.experts.scales[0, situation] += (wrong - model.experts.scales[0, situation]) >> 6
    _learn_range(model, image, c, laser, value, base, first, group, situation)


@inlined
def _code_mask_unmixed(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
    source: Words,
) -> int:  # fmt: skip
    """Code whether a firing has a return by one adaptive probability (effort `fast`)."""
    ranges, then = image.ranges, before.ranges
    context = _is(ranges, c - 1, laser) + 2 * _is(ranges, c - 2, laser)
    context += 4 * _is(ranges, c - 3, laser)
    if laser > 0:
        context += 8 * _is(ranges, c, laser - 1) + 16 * _is(ranges, c - 1, laser - 1)
    if laser + 1 < ranges.shape[1]:
        context += 32 * _is(ranges, c - 1, laser + 1)
    if t > 0:
        context += 64 * (1 + _is(then, t, laser) + 2 * _is(then, t + 1, laser))
        context += 320 * _is(then, t - 1, laser)
    return code_unmixed_bit(model.mask, context, 1 if source[c, laser] > 0 else 0)


@inlined
def _predict(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
) -> tuple[int, int, int, int, int]:  # fmt: skip
    """Predict a range, and return five values.

    The values are a base range, the predicted difference from it in quarter quanta, the level of
    recent errors (activity), whether the previous turn has a return here (1 or 0), and the index of
    the experts' scales (situation).
    """
    base = _base(model, image, before, c, laser, t)
    _write_features(model, image, before, c, laser, t, base)
    error = model.error[laser]
    level = activity(error, image.errors, before.errors, c, laser, t, _LEVELS)
    has_previous = 1 if t > 0 and before.ranges[t, laser] > 0 else 0
    situation = level * 4 + has_previous * 2 + 1 - _is(image.ranges, c - 1, laser)
    first = predicted(model.linear, 0)
    return base, first, level, has_previous, situation


@inlined
def _quantise(model: RangeModel, value: int, mean: int, situation: int) -> tuple[int, int, int]:
    """Return a quantised range in steps, and the arguments `centre` and `unit` of `code_number`."""
    step, lmbda = model.parameters[0], model.parameters[1]
    scale = model.experts.scales[0, situation] >> 8
    index = in_steps(value + (step >> 1), step)
    if lmbda > 0:
        index = _cheaper_index(value, index, mean, scale, step, lmbda)
    centre = max(in_steps((mean + FINE * step // 2) // FINE, step), 1)
    return index, centre, max(in_steps(scale * 3 // 64, step), 1)


@inlined
def _cheaper_index(value: int, index: int, mean: int, scale: int, step: int, lmbda: int) -> int:
    """Return `index`, or the neighbour towards `mean` if this lowers the rate-distortion cost.

    One step towards the prediction saves about step / scale nats.
    """
    other = index + 1 if FINE * step * index < mean else index - 1
    if other < 1 or abs(FINE * step * other - mean) >= abs(FINE * step * index - mean):
        return index
    near, far = value - step * index, value - step * other
    saved = lmbda * step * FINE * min(abs(FINE * step * index - mean), 2 * scale)
    # Errors are in squared quanta; lambda is in 1 / 16 squared quantum per nat.
    if 16 * (far * far - near * near) * 2 * max(scale, 1) * max(scale, 1) < saved:
        return other
    return index


@inlined
def _base(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int
) -> int:
    """Return the laser's last range, or else that of the laser below or of the previous turn."""
    base = int(model.last[laser])
    if base == 0 and laser > 0:
        base = int(image.ranges[c, laser - 1])
    if base == 0 and t > 0:
        base = int(before.ranges[t, laser])
    return base if base > 0 else 1000


@inlined
def _change(later: int, earlier: int) -> int:
    """Return a change of range in quarter quanta; 0 if over 60 quanta, or if a range is missing."""
    change = 4 * (later - earlier)
    return change if later > 0 and earlier > 0 and abs(change) <= 240 else 0


@inlined
def _write_features(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
    base: int,
) -> None:  # fmt: skip
    x, held, ranges = model.linear.features, image.held, image.ranges
    for k in range(3):
        x[k] = _change(held[c - 2 - k, laser], base)
    for k in range(3, _COMMON_FEATURES):
        x[k] = 0
    if laser > 0:
        x[3] = _change(ranges[c, laser - 1], held[c - 1, laser - 1])
        x[4] = _change(held[c - 2, laser - 1], held[c - 1, laser - 1])
    if t > 0:
        then = before.ranges
        for k in range(3):
            x[5 + k] = _change(then[t - 1 + k, laser], base)
        if laser > 0:
            x[8] = _change(ranges[c, laser - 1], then[t, laser - 1])
        x[9] = _fine_change(before.smooth[t, laser], base)
    if len(model.linear.every) > _COMMON_FEATURES:
        _write_more_features(x, image, before, c, laser, t, base)


@inlined
def _fine_change(later: int, base: int) -> int:
    change = (later - FINE * base) >> 2
    return change if later > 0 and abs(change) <= 240 else 0


@inlined
def _write_more_features(
    x: Words, image: RangeContext, before: RangeContext, c: int, laser: int, t: int, base: int,
) -> None:  # fmt: skip
    held, ranges = image.held, image.ranges
    x[10], x[11] = _change(held[c - 5, laser], base), _change(held[c - 6, laser], base)
    for k in range(12, 22):
        x[k] = 0
    if laser > 0:
        x[12] = _change(held[c - 3, laser - 1], held[c - 1, laser - 1])
    if laser > 1:
        x[13] = _change(ranges[c, laser - 2], held[c - 1, laser - 2])
        x[14] = _change(held[c - 2, laser - 2], held[c - 1, laser - 2])
        x[15] = _change(held[c - 3, laser - 2], held[c - 1, laser - 2])
    if laser + 1 < ranges.shape[1]:
        x[16] = _change(held[c - 1, laser + 1], held[c - 2, laser + 1])
    if t > 0:
        then = before.ranges
        x[17] = _change(then[t - 2, laser], base)
        x[18] = _change(then[t + 2, laser], base)
        x[19] = _change(then[t + 3, laser], base)
        x[20] = _fine_change(before.smooth[t - 1, laser], base)
        x[21] = _fine_change(before.smooth[t + 1, laser], base)


@inlined
def _write_experts(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
    base: int, mean: int, group: int,
) -> None:  # fmt: skip
    means = model.experts.means
    then = int(before.smooth[t, laser]) if t > 0 else 0
    means[0] = max(mean, 1)
    means[1] = then
    means[2] = FINE * base
    below = int(image.ranges[c, laser - 1]) if laser > 0 else 0
    means[3] = FINE * below
    if len(model.experts.every) <= 4:
        return
    means[4] = FINE * image.ranges[c - 1, laser + 1] if laser + 1 < image.ranges.shape[1] else 0
    means[5] = FINE * model.other[laser]
    if len(model.experts.every) <= _EXPERTS_OF_STEPS:
        return
    means[6], means[7] = 0, 0
    if below > 0 and image.held[c - 1, laser - 1] > 0:
        means[6] = max(FINE * (base + below - image.held[c - 1, laser - 1]), 0)
    if below > 0 and then > 0 and before.smooth[t, laser - 1] > 0:
        means[7] = max(then + FINE * below - before.smooth[t, laser - 1], 0)
    means[8] = max(FINE * base + 4 * predicted(model.linear, group), 1)


@inlined
def _write_contexts(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
    base: int, situation: int, mean: int,
) -> None:  # fmt: skip
    m, starts = model.value, model.starts
    unit = max(model.experts.scales[0, situation] * 3 >> 14, 1)
    centre = mean // FINE
    then, lower, upper = 9, 9, 9
    if t > 0:
        then = level_of_value(before.smooth[t, laser] // FINE, centre, unit)
    if laser > 0:
        lower = level_of_value(image.ranges[c, laser - 1], centre, unit)
    if laser + 1 < image.ranges.shape[1]:
        upper = level_of_value(image.ranges[c - 1, laser + 1], centre, unit)
    m.contexts[0] = starts[0] + (lower * 10 + upper) * NODES
    m.contexts[1] = starts[1] + situation * NODES
    m.contexts[2] = starts[2] + (then * 9 + level_of(base - centre, unit)) * NODES
    m.rows[0] = 0
    if len(m.sizes.contexts) > 3:
        _write_more_contexts(model, image, before, c, laser, t, centre, unit, then)
        m.rows[1] = (1 + (situation >> 2)) * NODES
        m.rows[2] = (1 + _LEVELS + (situation & 3)) * NODES


@inlined
def _write_more_contexts(
    model: RangeModel, image: RangeContext, before: RangeContext, c: int, laser: int, t: int,
    centre: int, unit: int, then: int,
) -> None:  # fmt: skip
    at, starts, means = model.value.contexts, model.starts, model.experts.means
    east, back = 9, 9
    if t > 0:
        east = level_of_value(before.ranges[t + 1, laser], centre, unit)
        back = level_of_value(before.ranges[t - 1, laser], centre, unit)
    below = level_of_value(means[6] // FINE, centre, unit)
    slope = level_of(image.held[c - 1, laser] - image.held[c - 2, laser], unit)
    other = level_of_value(model.other[laser], centre, unit)
    apart = level_of(means[8] // FINE - centre, max(unit // 4, 1))
    at[3] = starts[3] + (below * 9 + level_of(model.memory[0], unit)) * NODES
    at[4] = starts[4] + (east * 10 + back) * NODES
    at[5] = starts[5] + (slope * 10 + then) * NODES
    at[6] = starts[6] + laser * NODES
    at[7] = starts[7] + (other * 10 + apart) * NODES


@inlined
def _learn_range(
    model: RangeModel, image: RangeContext, c: int, laser: int, value: int, base: int, first: int,
    group: int, situation: int,
) -> None:  # fmt: skip
    mean = FINE * base + 4 * first
    wrong = FINE * value - mean
    learn(model.experts, situation, FINE * value, 7)
    image.ranges[c, laser] = value
    image.held[c, laser] = value
    image.errors[c, laser] = min(abs(wrong), 1000)
    image.smooth[c, laser] = max(mean + (wrong * 140 >> 8), 1) if abs(wrong) < 256 else FINE * value
    model.error[laser] += (image.errors[c, laser] - model.error[laser]) >> 2
    model.memory[0] = wrong >> 4
    target = 4 * (value - base)
    if abs(target - first) < 160:
        _learn_linear(model, target, group, max((situation >> 2) - 2, 0))
    if abs(value - model.last[laser]) > _JUMP:
        model.other[laser] = model.last[laser]
    model.last[laser] = value


@inlined
def _learn_linear(model: RangeModel, target: int, group: int, damp: int) -> None:
    linear = model.linear
    if len(model.experts.every) > 0:
        learn_target(linear, 0, target, damp, 12)
    elif model.memory[1] & 1 == 0 or model.memory[1] < _ALL_LEARNT:
        learn_target(linear, 0, target, damp, 11)
    if group > 0:
        learn_target(linear, group, target, damp, 10)
    model.memory[1] += 1
    if model.memory[1] % model.parameters[3] == 0:
        solve(linear, 0)
        if group > 0:
            solve(linear, group)

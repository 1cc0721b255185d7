"""Ranges of a turn: which firings returned, and from how far; column by column, low lasers first.

A range is predicted from the same laser's columns before, the lasers around it and the turn before
(least squares that learn while coding), and coded by binary decisions around the prediction. Each
decision mixes experts with adaptive contexts.

Lossy coding quantises a range to a multiple of the step. The next multiple is taken in place of the
nearest one where it costs so many bits less that lambda times these outweighs the greater error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.coding.binary_coder import BitCoder, exhausted
from puckbench.core.compiling import compiled_in_place, inlined
from puckbench.puck.experts import (
    FINE,
    Experts,
    begin,
    learn,
    new_experts,
)
from puckbench.puck.least_squares import (
    LeastSquares,
    learn_target,
    new_least_squares,
    predicted,
    solve,
)
from puckbench.puck.mixing import Ints, Mixer, Words, code_bit, new_mixer
from puckbench.puck.numbers import (
    FARTHEST,
    NODES,
    code_number,
    code_plain_bit,
    code_plain_number,
    halves,
    in_steps,
    level_of,
)
from puckbench.puck.options import Effort

PAD = 8
"""Rows of an image before its first column: the last columns of the turn before."""
_LEVELS = 16
"""Levels of activity: of how large errors are round about."""
_SITUATIONS = 4 * _LEVELS
_JUMP = 24
"""Quanta from which on a difference between columns is another surface."""
_FIRST_ERROR = 3 * FINE


class Image(NamedTuple):
    """A turn, (PAD + columns, lasers) each; the lasers by elevation.

    ranges: 0 for no return. smooth: ranges, in 1 / FINE, drawn towards their predictions. errors:
    of the predictions, in 1 / FINE. held: the last range of the laser up to there.
    """

    ranges: Words
    smooth: Words
    errors: Words
    held: Words


class Model(NamedTuple):
    """What the coder has learnt.

    mask, value: mixers of the decisions. starts: first counters of their contexts. experts,
    linear: of the prediction. last, other, gap, error: of each laser: the last range, that of the
    surface before, columns since it last began or ceased to return, recent error. memory: last
    signed error, number of returns. settings: step, lambda, predictors in use, returns from one
    sweep of the solver to the next.
    """

    mask: Mixer
    value: Mixer
    starts: Ints
    mask_starts: Ints
    experts: Experts
    linear: LeastSquares
    last: Ints
    other: Ints
    gap: Ints
    error: Ints
    memory: Ints
    settings: Ints


class ModelSize(NamedTuple):
    """How much is done for a return: a prefix of the lists of features, experts and contexts."""

    features: int
    experts: int
    contexts: int
    sets: int
    mask_contexts: int
    predictors: int
    every: int


MODEL_SIZES: dict[Effort, ModelSize] = {
    "fast": ModelSize(10, 0, 1, 1, 1, 1, 32),
    "normal": ModelSize(10, 3, 3, 1, 3, 1, 16),
    "thorough": ModelSize(22, 9, 8, 3, 6, 9, 8),
}
_EXPERT_WEIGHTS = (0.18, 0.2, 0.16, 0.15, 0.1, 0.2, 0.22, 0.16, 0.16)
_CONTEXT_WEIGHTS = (0.15, 0.2, 0.12, 0.13, 0.05, 0.16, 0.1, 0.15)
_MASK_WEIGHTS = (0.3, 0.16, 0.08, 0.15, 0.14, 0.3)
"""Initial weights, near to what an HDL-32E's recording ends with."""
_NEAR = 10
"""Features that every effort takes."""


def new_model(bits: BitCoder, lasers: int, size: ModelSize, step: int, lmbda: int) -> Model:
    """A coder that has learnt nothing."""
    sizes = np.array([100, _SITUATIONS, 90, 90, 100, 90, lasers, 100]) * NODES
    mask_sizes = np.array([2304, 216 * lasers, 2592, 1296, 3264, 64 * lasers])
    first_weights = [*_EXPERT_WEIGHTS[: size.experts], *_CONTEXT_WEIGHTS[: size.contexts]]
    zeros = np.zeros(lasers, np.int64)
    return Model(
        new_mixer(bits, 0, size.mask_contexts, int(mask_sizes.sum()), 64 + lasers,
                  min(size.sets, 2), (24, 5, 160), _MASK_WEIGHTS[: size.mask_contexts]),
        new_mixer(bits, size.experts, size.contexts, int(sizes.sum()),
                  NODES * (1 + _LEVELS + 4), size.sets, (24, 4, 160), first_weights),
        np.cumsum(sizes) - sizes,
        np.cumsum(mask_sizes) - mask_sizes,
        new_experts(_first_scales(size.experts), size.experts),
        new_least_squares(size.predictors, size.features),
        zeros, zeros.copy(), zeros.copy(), zeros + _FIRST_ERROR,
        np.zeros(2, np.int64),
        np.array([step, lmbda, size.predictors, size.every], np.int64),
    )  # fmt: skip


def with_bits(model: Model, bits: BitCoder) -> Model:
    """The model at the beginning of another stream."""
    return model._replace(
        mask=model.mask._replace(bits=bits), value=model.value._replace(bits=bits)
    )


def _first_scales(experts: int) -> Words:
    """Scales to begin with: what a level of activity means, times each expert's usual error."""
    level = np.arange(_LEVELS) + 6
    usual = (1 << level // 2) * (2 + level % 2) * 128
    times = np.array([1, 1.2, 1.4, 1.4, 6, 1.4, 1, 6, 6])[: max(experts, 1), None]
    scales: Words = np.rint(np.repeat(usual, 4) * times).astype(np.int32)
    return scales


@compiled_in_place
def code_ranges(model: Model, image: Image, before: Image, places: Ints, source: Words) -> bool:
    """Code a turn's ranges; whether a reader's stream was long enough.

    Parameters
    ----------
    model
        Writes or reads the stream.
    image
        The turn, whose first PAD rows are given; the others are filled.
    before
        The turn before, PAD rows longer.
    places
        (columns,), the nearest row of the turn before, or 0.
    source
        (PAD + columns, lasers), what a writer codes.
    """
    is_plain = len(model.experts.every) == 0
    for column in range(PAD, len(image.ranges)):
        place = places[column - PAD]
        for laser in range(image.ranges.shape[1]):
            if is_plain:
                exists = _code_mask_plainly(model, image, before, column, laser, place, source)
            else:
                exists = _code_mask(model, image, before, column, laser, place, source)
            if exists == 1 and is_plain:
                _code_range_plainly(model, image, before, column, laser, place, source)
            elif exists == 1:
                _code_range(model, image, before, column, laser, place, source)
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
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, source: Words,
) -> int:  # fmt: skip
    """Code whether a firing returned."""
    ranges, mask, starts = image.ranges, model.mask, model.mask_starts
    lasers = ranges.shape[1]
    west, west2 = _is(ranges, c - 1, laser), _is(ranges, c - 2, laser)
    own = west + 2 * west2 + 4 * _is(ranges, c - 3, laser)
    below, below1, below_two = 2, 0, 0
    if laser > 0:
        below = _is(ranges, c, laser - 1)
        below1 = _is(ranges, c - 1, laser - 1)
    if laser > 1:
        below_two = _is(ranges, c, laser - 2)
    above, above2 = 0, 0
    if laser + 1 < lasers:
        above, above2 = _is(ranges, c - 1, laser + 1), _is(ranges, c - 2, laser + 1)
    here, east, back, east2, back2, under, reach = 2, 2, 2, 0, 0, 0, 0
    if t > 0:
        then = before.ranges
        here, east, back = _is(then, t, laser), _is(then, t + 1, laser), _is(then, t - 1, laser)
        east2, back2 = _is(then, t + 2, laser), _is(then, t - 2, laser)
        reach = min(halves(then[t, laser]) >> 1, 16)
        if laser > 0:
            under = _is(then, t, laser - 1)
    at, count = mask.at, len(mask.contexts)
    around = (
        (((own * 2 + _is(ranges, c - 4, laser)) * 3 + below) * 2 + below1) * 2 + below_two
    ) * 2
    at[0] = starts[0] + ((around + above) * 2 + above2) * 3 + here
    at[1] = starts[1] + laser * 216 + own * 27 + here * 9 + east * 3 + back
    then_bits = (((here * 3 + east) * 3 + back) * 2 + east2) * 2 + back2
    at[2] = starts[2] + ((then_bits * 3 + below) * 2 + under) * 2 + west
    if count > 3:
        at[3] = starts[3] + (((west * 3 + below) * 2 + below1) * 2 + above) * 3 + here
        at[4] = (
            starts[4] + ((min(halves(model.last[laser]), 31) * 17 + reach) * 2 + west) * 3 + here
        )
        at[5] = starts[5] + (laser * 16 + min(model.gap[laser], 15)) * 4 + west * 2 + (below & 1)
    mask.rows[0] = ((west * 3 + below) * 3 + here) * 2 + west2
    if len(mask.sets) > 1:
        mask.rows[1] = 64 + laser
    exists = code_bit(mask, 1 if source[c, laser] > 0 else 0, 0, 0)
    model.gap[laser] = model.gap[laser] + 1 if exists == west else 0
    return exists


@inlined
def _code_range(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, source: Words,
) -> None:  # fmt: skip
    """Code the range of a return."""
    base, first, activity, is_known, situation = _predict(model, image, before, c, laser, t)
    mean = FINE * base + 4 * first
    group = 0
    if model.settings[2] > 1:
        group = 1 + 2 * min(max(activity - 2, 0) // 3, 3) + is_known
    _find_experts(model, image, before, c, laser, t, base, mean, group)
    begin(model.experts, situation)
    _find_contexts(model, image, before, c, laser, t, base, situation, mean)
    index, centre, unit = _quantise(model, source[c, laser], mean, situation)
    step = model.settings[0]
    index = code_number(model.value, model.experts, index, centre, unit, step)
    value = min(max(index * step, 1), FARTHEST)
    _learn_range(model, image, c, laser, value, base, first, group, situation)


@inlined
def _code_mask_plainly(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, source: Words,
) -> int:  # fmt: skip
    """Code whether a firing returned, by one adaptive probability."""
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
    return code_plain_bit(model.mask, context, 1 if source[c, laser] > 0 else 0)


@inlined
def _code_range_plainly(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, source: Words,
) -> None:  # fmt: skip
    """Code the range of a return by adaptive probabilities alone."""
    base, first, activity, is_known, situation = _predict(model, image, before, c, laser, t)
    mean = FINE * base + 4 * first
    index, centre, unit = _quantise(model, source[c, laser], mean, situation)
    step, then = model.settings[0], 9
    if is_known == 1:
        then = level_of(before.smooth[t, laser] - mean, FINE * unit * step)
    start = (then * _LEVELS + activity) * NODES
    index = code_plain_number(model.value, model.experts, start, index, centre, unit, step)
    value = min(max(index * step, 1), FARTHEST)
    wrong = min(abs(FINE * value - mean), 4000) * 256
    model.experts.scales[0, situation] += (wrong - model.experts.scales[0, situation]) >> 6
    _learn_range(model, image, c, laser, value, base, first, 0, situation)


@inlined
def _predict(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int,
) -> tuple[int, int, int, int, int]:  # fmt: skip
    """Predict a range: its base, the difference to it in quarter quanta, and how sure that is.

    How sure: the activity round about, whether the turn before has a return there (0 or 1), and the
    situation, which adds whether the laser's last firing returned; errors are learnt by it.
    """
    base = _base(model, image, before, c, laser, t)
    _find_features(model, image, before, c, laser, t, base)
    activity = _activity(model, image, before, c, laser, t)
    is_known = 1 if t > 0 and before.ranges[t, laser] > 0 else 0
    situation = activity * 4 + is_known * 2 + 1 - _is(image.ranges, c - 1, laser)
    first = predicted(model.linear, 0)
    return base, first, activity, is_known, situation


@inlined
def _quantise(model: Model, value: int, mean: int, situation: int) -> tuple[int, int, int]:
    """A range in steps, and the centre and the unit of the decisions that code it."""
    step, lmbda = model.settings[0], model.settings[1]
    scale = model.experts.scales[0, situation] >> 8
    index = in_steps(value + (step >> 1), step)
    if lmbda > 0:
        index = _chosen(value, index, mean, scale, step, lmbda)
    centre = max(in_steps((mean + FINE * step // 2) // FINE, step), 1)
    return index, centre, max(in_steps(scale * 3 // 64, step), 1)


@inlined
def _chosen(value: int, index: int, mean: int, scale: int, step: int, lmbda: int) -> int:
    """The nearest index or its neighbour on the prediction's side (rate-distortion optimisation).

    Towards a prediction whose errors have mean `scale`, a step saves about step / scale nats.
    """
    other = index + 1 if FINE * step * index < mean else index - 1
    if other < 1 or abs(FINE * step * other - mean) >= abs(FINE * step * index - mean):
        return index
    near, far = value - step * index, value - step * other
    saved = lmbda * step * FINE * min(abs(FINE * step * index - mean), 2 * scale)
    # Errors in quanta squared; lambda in 1 / 16 quantum squared a nat.
    if 16 * (far * far - near * near) * 2 * max(scale, 1) * max(scale, 1) < saved:
        return other
    return index


@inlined
def _base(model: Model, image: Image, before: Image, c: int, laser: int, t: int) -> int:
    """The range that features are differences to: the laser's last, or what is nearest to it."""
    base = int(model.last[laser])
    if base == 0 and laser > 0:
        base = int(image.ranges[c, laser - 1])
    if base == 0 and t > 0:
        base = int(before.ranges[t, laser])
    return base if base > 0 else 1000


@inlined
def _change(later: int, earlier: int) -> int:
    """A difference of ranges in quarter quanta; 0 when one is missing or the surface another."""
    change = 4 * (later - earlier)
    return change if later > 0 and earlier > 0 and abs(change) <= 240 else 0


@inlined
def _find_features(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, base: int,
) -> None:  # fmt: skip
    """Find the differences that the prediction is linear in."""
    x, held, ranges = model.linear.features, image.held, image.ranges
    for k in range(3):
        x[k] = _change(held[c - 2 - k, laser], base)
    x[3], x[4] = 0, 0
    if laser > 0:
        x[3] = _change(ranges[c, laser - 1], held[c - 1, laser - 1])
        x[4] = _change(held[c - 2, laser - 1], held[c - 1, laser - 1])
    for k in range(5, 10):
        x[k] = 0
    if t > 0:
        then = before.ranges
        for k in range(3):
            x[5 + k] = _change(then[t - 1 + k, laser], base)
        if laser > 0:
            x[8] = _change(ranges[c, laser - 1], then[t, laser - 1])
        x[9] = _fine_change(before.smooth[t, laser], base)
    if len(model.linear.every) > _NEAR:
        _find_more_features(x, image, before, c, laser, t, base)


@inlined
def _fine_change(later: int, base: int) -> int:
    change = (later - FINE * base) >> 2
    return change if later > 0 and abs(change) <= 240 else 0


@inlined
def _find_more_features(
    x: Words, image: Image, before: Image, c: int, laser: int, t: int, base: int,
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
def _find_experts(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, base: int, mean: int,
    group: int,
) -> None:  # fmt: skip
    """Find the experts' means, in 1 / FINE."""
    means = model.experts.means
    then = int(before.smooth[t, laser]) if t > 0 else 0
    means[0] = max(mean, 1)
    means[1] = then
    means[2] = FINE * base
    if len(model.experts.every) <= 3:
        return
    below = int(image.ranges[c, laser - 1]) if laser > 0 else 0
    means[3], means[5] = 0, 0
    if below > 0 and image.held[c - 1, laser - 1] > 0:
        means[3] = max(FINE * (base + below - image.held[c - 1, laser - 1]), 0)
    means[4] = FINE * model.other[laser]
    if below > 0 and then > 0 and before.smooth[t, laser - 1] > 0:
        means[5] = max(then + FINE * below - before.smooth[t, laser - 1], 0)
    means[6] = max(FINE * base + 4 * predicted(model.linear, group), 1)
    means[7] = FINE * below
    means[8] = FINE * image.ranges[c - 1, laser + 1] if laser + 1 < image.ranges.shape[1] else 0


@inlined
def _activity(model: Model, image: Image, before: Image, c: int, laser: int, t: int) -> int:
    """Level of how large the errors are round about."""
    own = model.error[laser]
    total = 2 * own
    total += image.errors[c, laser - 1] if laser > 0 else own
    total += image.errors[c - 1, laser + 1] if laser + 1 < image.ranges.shape[1] else own
    if t > 0:
        errors = before.errors
        total += 2 * errors[t, laser] + errors[t + 1, laser] + errors[t - 1, laser]
    else:
        total += 4 * own
    return min(max(halves(total >> 3) - 6, 0), _LEVELS - 1)


@inlined
def _find_contexts(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, base: int,
    situation: int, mean: int,
) -> None:  # fmt: skip
    """Find the contexts, but for the node of the decision, and the rows of weights.

    They are kept in the mixer's `at` and `rows`; `code_number` adds the node.
    """
    m, starts = model.value, model.starts
    unit = max(model.experts.scales[0, situation] * 3 >> 14, 1)
    centre = mean // FINE
    then, lower, upper = 9, 9, 9
    if t > 0:
        then = _place(before.smooth[t, laser] // FINE, centre, unit)
    if laser > 0:
        lower = _place(image.ranges[c, laser - 1], centre, unit)
    if laser + 1 < image.ranges.shape[1]:
        upper = _place(image.ranges[c - 1, laser + 1], centre, unit)
    m.at[0] = starts[0] + (lower * 10 + upper) * NODES
    m.at[1] = starts[1] + situation * NODES
    m.at[2] = starts[2] + (then * 9 + level_of(base - centre, unit)) * NODES
    m.rows[0] = 0
    if len(m.contexts) > 3:
        _find_more_contexts(model, image, before, c, laser, t, centre, unit, then)
        m.rows[1] = (1 + (situation >> 2)) * NODES
        m.rows[2] = (1 + _LEVELS + (situation & 3)) * NODES


@inlined
def _place(value: int, centre: int, unit: int) -> int:
    """Level of a range's distance from the centre; 9 for no return."""
    return level_of(value - centre, unit) if value > 0 else 9


@inlined
def _find_more_contexts(
    model: Model, image: Image, before: Image, c: int, laser: int, t: int, centre: int, unit: int,
    then: int,
) -> None:  # fmt: skip
    at, starts, means = model.value.at, model.starts, model.experts.means
    east, back = 9, 9
    if t > 0:
        east = _place(before.ranges[t + 1, laser], centre, unit)
        back = _place(before.ranges[t - 1, laser], centre, unit)
    below = _place(means[3] // FINE, centre, unit)
    slope = level_of(image.held[c - 1, laser] - image.held[c - 2, laser], unit)
    other = _place(model.other[laser], centre, unit)
    apart = level_of(means[6] // FINE - centre, max(unit // 4, 1))
    at[3] = starts[3] + (below * 9 + level_of(model.memory[0], unit)) * NODES
    at[4] = starts[4] + (east * 10 + back) * NODES
    at[5] = starts[5] + (slope * 10 + then) * NODES
    at[6] = starts[6] + laser * NODES
    at[7] = starts[7] + (other * 10 + apart) * NODES


@inlined
def _learn_range(
    model: Model, image: Image, c: int, laser: int, value: int, base: int, first: int, group: int,
    situation: int,
) -> None:  # fmt: skip
    """Store a range, and let everything learn from it."""
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
def _learn_linear(model: Model, target: int, group: int, damp: int) -> None:
    """Let the linear predictions learn."""
    linear = model.linear
    learn_target(linear, 0, target, damp, 12)
    if group > 0:
        learn_target(linear, group, target, damp, 10)
    model.memory[1] += 1
    if model.memory[1] % model.settings[3] == 0:
        solve(linear, 0)
        if group > 0:
            solve(linear, group)

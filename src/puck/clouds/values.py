"""Coding of ranges, intensities and other noisy columns from the points' neighbours.

As in `puck.ranges`, numbers are predicted by adaptive least squares, and coded as binary decisions
around the predictions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import BitCoder, exhausted
from pointkit.coding.context_mixing import Ints, Mixer, MixerOptions, Words, new_mixer
from pointkit.compiling import compiled_in_place, inlined
from puck.clouds.series import RINGS
from puck.experts import FINE, Experts, begin, first_scales, learn, new_experts
from puck.least_squares import LeastSquares, learn_target, new_least_squares, predicted, solve
from puck.numbers import NODES, code_number, halves, level_of, level_of_value
from puck.options import Effort

_LEVELS = 20
_SITUATIONS = 4 * _LEVELS
_EXPERTS, _CONTEXTS, _MORE_CONTEXTS, _FEATURES = 5, 6, 9, 12
_NEAR = 60 * 4
"""A larger difference of ranges, in quarters, is an edge, and no feature."""
_CLIP = 120 * 4
_NEAR_ERROR = 160
"""Ranges with a larger error, in quarters, are edges from which predictors do not learn."""
_MOST_ERROR, _MOST_RANGE_ERROR = 1 << 16, 1000
_ALL_LEARNT = 1000
"""Number of values after which effort `fast` learns from every second value only."""
_SIZES = np.array([100, _SITUATIONS, 90, RINGS, 257 * 4, 100, 90, 100, 257 * 33]) * NODES


class ValueModel(NamedTuple):
    mixer: Mixer
    starts: Ints
    experts: Experts
    linear: LeastSquares
    error: Ints  # running mean of each ring's errors, in 1 / FINE
    memory: Ints  # number of values


class ValueColumn(NamedTuple):
    """Values and errors of a cloud, whose last elements stand for missing neighbours."""

    values: Words  # (n + 1,), at least 1, and 0 for none
    errors: Words  # (n + 1,), absolute errors in 1 / FINE


def new_value_model(bits: BitCoder, effort: Effort) -> ValueModel:
    """Return a model that has learnt nothing yet."""
    experts, contexts = (0, 1) if effort == "fast" else (_EXPERTS, _CONTEXTS)
    if effort == "thorough":
        contexts = _MORE_CONTEXTS
    return ValueModel(
        new_mixer(bits, MixerOptions(
            experts=experts, contexts=contexts, counters=int(_SIZES.sum()),
            rows=NODES * (1 + _LEVELS), weights=[0.2] * experts + [0.15] * contexts,
            learning_rate=24, final_learning_rate=4, sets=1 if effort == "fast" else 2,
        )),
        np.cumsum(_SIZES) - _SIZES,
        new_experts(np.tile(np.repeat(first_scales(_LEVELS, 4), 4), (max(experts, 1), 1)), experts),
        new_least_squares(1, _FEATURES),
        np.full(RINGS, 3 * FINE, np.int64),
        np.zeros(1, np.int64),
    )  # fmt: skip


def blank_column(count: int) -> ValueColumn:
    """Return a column for `count` values that will be decoded; all of its numbers are 0."""
    return ValueColumn(*np.zeros((2, count + 1), np.int32))


@compiled_in_place
def code_values(
    model: ValueModel, column: ValueColumn, before: ValueColumn, neighbours: Words, rings: Words,
    farthest: int, is_range: bool,
) -> bool:  # fmt: skip
    """Encode or decode a column in place, and return False if the stream ends early.

    Parameters
    ----------
    model
        The model, which holds the arithmetic encoder or decoder.
    column
        The column: an encoder reads its values.
    before
        The same column of the cloud before.
    neighbours
        Indices of neighbours (n, 11), see `neighbours_of`.
    rings
        Number of each point's ring (n,).
    farthest
        Largest value.
    is_range
        Whether large differences between neighbours are edges.
    """
    values, is_fast = column.values, len(model.experts.every) == 0
    for i in range(len(rings)):
        near, ring = neighbours[i], rings[i]
        base = _base(values, before.values, near, farthest)
        _write_features(model.linear.features, values, before.values, near, base, is_range)
        first = predicted(model.linear, 0)
        mean = min(max(FINE * base + 4 * first, FINE), FINE * farthest)
        activity = _activity(column, before, near, int(model.error[ring]))
        situation = activity * 4 + (2 if before.values[near[8]] > 0 else 0)
        situation += 1 if values[near[0]] > 0 else 0
        unit = max((int(model.experts.scales[0, situation]) >> 8) * 3 // 64, 1)
        centre, start, smooth = (mean + FINE // 2) // FINE, -1, unit
        if is_fast:
            then = level_of_value(int(before.values[near[8]]), centre, unit)
            start = (then * _LEVELS + activity) * NODES
        else:
            smooth = max(unit >> 2, 1)
            _write_experts(model, values, before.values, near, base, mean, situation)
            _write_contexts(model, values, before.values, near, base, centre, unit)
            at, starts = model.mixer.contexts, model.starts
            at[1], at[3] = starts[1] + situation * NODES, starts[3] + ring * NODES
            model.mixer.rows[0], model.mixer.rows[1] = 0, (1 + activity) * NODES
            if len(model.mixer.sizes.contexts) > _CONTEXTS:
                smooth = 1
                _write_more_contexts(model, values, near, centre, unit)
        value = code_number(
            model.mixer, model.experts, int(values[i]), centre, unit, 1, farthest, smooth, start
        )
        value = min(max(value, 1), farthest)
        values[i] = value
        column.errors[i] = min(abs(FINE * value - mean), _MOST_ERROR)
        _learn_error(model, ring, situation, FINE * value, int(column.errors[i]), is_range)
        _learn_linear(model, 4 * (value - base), first, activity, is_range)
        if i & 255 == 0 and exhausted(model.mixer.bits):
            return False
    return not exhausted(model.mixer.bits)


@inlined
def _base(values: Words, past: Words, near: Words, farthest: int) -> int:
    """Return the value before on the ring, or else that below or of the cloud before."""
    base = int(values[near[0]])
    if base == 0:
        base = int(values[near[3]])
    if base == 0:
        base = int(past[near[8]])
    return base if base > 0 else min(1000, (farthest + 1) >> 1)


@inlined
def _change(later: int, earlier: int, is_range: bool) -> int:
    if later == 0 or earlier == 0:
        return 0
    change = 4 * (later - earlier)
    if is_range:
        return change if abs(change) <= _NEAR else 0
    return min(max(change, -_CLIP), _CLIP)


@inlined
def _write_features(
    x: Words, values: Words, past: Words, near: Words, base: int, is_range: bool
) -> None:
    below, above, then = int(values[near[3]]), int(values[near[6]]), int(past[near[8]])
    x[0] = _change(int(values[near[1]]), base, is_range)
    x[1] = _change(int(values[near[2]]), base, is_range)
    x[2] = _change(below, int(values[near[4]]), is_range)
    x[3] = _change(int(values[near[5]]), below, is_range)
    x[4] = _change(int(past[near[9]]), base, is_range)
    x[5] = _change(then, base, is_range)
    x[6] = _change(int(past[near[10]]), base, is_range)
    x[7] = _change(above, int(values[near[7]]), is_range)
    x[8] = _change(below, base, is_range)
    x[9] = _change(above, base, is_range)
    x[10] = _change(below, then, is_range)
    x[11] = 8


@inlined
def _activity(column: ValueColumn, before: ValueColumn, near: Words, error: int) -> int:
    """Return the level of the errors around a point, where the mean of its ring is `error`."""
    total = 2 * error
    total += int(column.errors[near[3]]) if column.values[near[3]] > 0 else error
    total += int(column.errors[near[6]]) if column.values[near[6]] > 0 else error
    if before.values[near[8]] > 0:
        total += 2 * int(before.errors[near[8]])
        total += int(before.errors[near[9]]) + int(before.errors[near[10]])
    else:
        total += 4 * error
    return min(max(halves(total >> 3) - 4, 0), _LEVELS - 1)


@inlined
def _write_experts(
    model: ValueModel, values: Words, past: Words, near: Words, base: int, mean: int,
    situation: int,
) -> None:  # fmt: skip
    means = model.experts.means
    means[0], means[1], means[2] = mean, FINE * int(past[near[8]]), FINE * base
    means[3], means[4] = FINE * int(values[near[3]]), FINE * int(values[near[6]])
    begin(model.experts, situation)


@inlined
def _write_contexts(
    model: ValueModel, values: Words, past: Words, near: Words, base: int, centre: int, unit: int
) -> None:
    at, starts = model.mixer.contexts, model.starts
    below = level_of_value(int(values[near[3]]), centre, unit)
    above = level_of_value(int(values[near[6]]), centre, unit)
    then = level_of_value(int(past[near[8]]), centre, unit)
    back = level_of_value(int(past[near[9]]), centre, unit)
    east = level_of_value(int(past[near[10]]), centre, unit)
    at[0] = starts[0] + (below * 10 + above) * NODES
    at[2] = starts[2] + (then * 9 + level_of(base - centre, unit)) * NODES
    at[4] = starts[4] + (min(int(values[near[0]]), 256) * 4 + (then & 3)) * NODES
    at[5] = starts[5] + (east * 10 + back) * NODES


@inlined
def _write_more_contexts(
    model: ValueModel, values: Words, near: Words, centre: int, unit: int
) -> None:
    at, starts = model.mixer.contexts, model.starts
    west, below = int(values[near[0]]), int(values[near[3]])
    slope = level_of(west - int(values[near[1]]), unit)
    east = level_of_value(int(values[near[5]]), centre, unit)
    above_west = level_of_value(int(values[near[7]]), centre, unit)
    at[6] = starts[6] + (slope * 10 + level_of_value(below, centre, unit)) * NODES
    at[7] = starts[7] + (east * 10 + above_west) * NODES
    at[8] = starts[8] + (min(west, 256) * 33 + min(below >> 3, 32)) * NODES


@inlined
def _learn_error(
    model: ValueModel, ring: int, situation: int, number: int, wrong: int, is_range: bool
) -> None:
    scales = model.experts.scales
    if len(model.experts.every) == 0:
        scales[0, situation] += (min(wrong, 4000) * 256 - scales[0, situation]) >> 6
    else:
        learn(model.experts, situation, number, 7)
    most = _MOST_RANGE_ERROR if is_range else _MOST_ERROR
    model.error[ring] += (min(wrong, most) - model.error[ring]) >> 2


@inlined
def _learn_linear(
    model: ValueModel, target: int, first: int, activity: int, is_range: bool
) -> None:
    if abs(target - first) >= (_NEAR_ERROR if is_range else 2 * _CLIP):
        return
    model.memory[0] += 1
    coded = model.memory[0]
    if len(model.experts.every) > 0 or coded & 1 == 0 or coded < _ALL_LEARNT:
        learn_target(model.linear, 0, target, max(activity - 4, 0) if is_range else 4, 11)
    if coded & 15 == 0:
        solve(model.linear, 0)

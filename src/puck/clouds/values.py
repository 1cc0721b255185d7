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
_MOST_ERROR = 1 << 16
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
        new_experts(np.repeat(first_scales(_LEVELS, 4), 4)[None].repeat(max(experts, 1), 0), experts),
        new_least_squares(1, _FEATURES),
        np.full(RINGS, 3 * FINE, np.int64),
        np.zeros(1, np.int64),
    )  # fmt: skip


def blank_column(count: int) -> ValueColumn:
    """Return a column of `count` values that are not known yet."""
    return ValueColumn(*np.zeros((2, count + 1), np.int32))


@inlined
def _change(later: int, earlier: int, is_range: bool) -> int:
    if later == 0 or earlier == 0:
        return 0
    change = 4 * (later - earlier)
    if is_range:
        return change if abs(change) <= _NEAR else 0
    return min(max(change, -_CLIP), _CLIP)


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
    values, errors, mixer, experts = column.values, column.errors, model.mixer, model.experts
    past, x, linear, starts = before.values, model.linear.features, model.linear, model.starts
    is_fast = len(experts.every) == 0
    for i in range(len(rings)):
        near = neighbours[i]
        ring = rings[i]
        west, west2, west3 = int(values[near[0]]), int(values[near[1]]), int(values[near[2]])
        below, below_west, below_east = values[near[3]], values[near[4]], values[near[5]]
        above, above_west = int(values[near[6]]), int(values[near[7]])
        then, then_west, then_east = past[near[8]], past[near[9]], past[near[10]]
        base = west if west > 0 else int(below)
        if base == 0:
            base = int(then)
        if base == 0:
            base = min(1000, (farthest + 1) >> 1)
        x[0], x[1] = _change(west2, base, is_range), _change(west3, base, is_range)
        x[2] = _change(int(below), int(below_west), is_range)
        x[3] = _change(int(below_east), int(below), is_range)
        x[4] = _change(int(then_west), base, is_range)
        x[5] = _change(int(then), base, is_range)
        x[6] = _change(int(then_east), base, is_range)
        x[7] = _change(above, above_west, is_range)
        x[8] = _change(int(below), base, is_range)
        x[9] = _change(above, base, is_range)
        x[10] = _change(int(below), int(then), is_range)
        x[11] = 8
        first = predicted(linear, 0)
        mean = FINE * base + 4 * first
        mean = min(max(mean, FINE), FINE * farthest)
        error = int(model.error[ring])
        total = 2 * error + (int(errors[near[3]]) if below > 0 else error)
        total += int(errors[near[6]]) if above > 0 else error
        if then > 0:
            total += 2 * int(before.errors[near[8]])
            total += int(before.errors[near[9]]) + int(before.errors[near[10]])
        else:
            total += 4 * error
        activity = min(max(halves(total >> 3) - 4, 0), _LEVELS - 1)
        situation = activity * 4 + (2 if then > 0 else 0) + (1 if west > 0 else 0)
        scale = int(experts.scales[0, situation]) >> 8
        unit = max(scale * 3 // 64, 1)
        centre = (mean + FINE // 2) // FINE
        then_level = level_of_value(int(then), centre, unit)
        at, start = mixer.contexts, -1
        if is_fast:
            start = (then_level * _LEVELS + activity) * NODES
            smooth = max(unit, 1)
        else:
            means = experts.means
            means[0], means[1] = mean, FINE * then
            means[2], means[3], means[4] = FINE * base, FINE * below, FINE * above
            begin(experts, situation)
            lower, upper = (
                level_of_value(int(below), centre, unit), level_of_value(above, centre, unit),
            )  # fmt: skip
            at[0] = starts[0] + (lower * 10 + upper) * NODES
            at[1] = starts[1] + situation * NODES
            at[2] = starts[2] + (then_level * 9 + level_of(base - centre, unit)) * NODES
            at[3] = starts[3] + ring * NODES
            at[4] = starts[4] + (min(west, 256) * 4 + (then_level & 3)) * NODES
            east_level = level_of_value(int(then_east), centre, unit)
            back_level = level_of_value(int(then_west), centre, unit)
            at[5] = starts[5] + (east_level * 10 + back_level) * NODES
            smooth = max(unit >> 2, 1)
            if len(mixer.sizes.contexts) > _CONTEXTS:
                slope, near_below = (
                    level_of(west - west2, unit),
                    level_of_value(int(below_east), centre, unit),
                )
                at[6] = starts[6] + (slope * 10 + lower) * NODES
                at[7] = (
                    starts[7] + (near_below * 10 + level_of_value(above_west, centre, unit)) * NODES
                )
                at[8] = starts[8] + (min(west, 256) * 33 + min(int(below) >> 3, 32)) * NODES
                smooth = 1
            mixer.rows[0], mixer.rows[1] = 0, (1 + activity) * NODES
        value = code_number(
            mixer, experts, int(values[i]), centre, unit, 1, farthest, smooth, start
        )
        value = min(max(value, 1), farthest)
        values[i] = value
        signed = FINE * value - mean
        wrong = min(abs(signed), _MOST_ERROR)
        if is_fast:
            miss = min(wrong, 4000) * 256
            experts.scales[0, situation] += (miss - experts.scales[0, situation]) >> 6
        else:
            learn(experts, situation, FINE * value, 7)
        errors[i] = wrong
        model.error[ring] += (min(wrong, 1000 if is_range else _MOST_ERROR) - error) >> 2
        target = 4 * (value - base)
        if abs(target - first) < (160 if is_range else 2 * _CLIP):
            model.memory[0] += 1
            if not is_fast or model.memory[0] & 1 == 0 or model.memory[0] < 1000:
                learn_target(linear, 0, target, max(activity - 4, 0) if is_range else 4, 11)
            if model.memory[0] & 15 == 0:
                solve(linear, 0)
        if i & 255 == 0 and exhausted(mixer.bits):
            return False
    return not exhausted(mixer.bits)

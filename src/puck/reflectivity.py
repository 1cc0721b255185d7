"""Coding of the reflectivities of a turn: a byte for each firing, with or without a return.

Some values are guessed, and are only coded if a flag marks the guess as wrong. For a second return
at the range of the first, the guess is the first return's value. For a firing without a return, it
is the value of the laser's last such firing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import BitCoder, exhausted
from pointkit.coding.context_mixing import Ints, Mixer, MixerOptions, Words, code_bit, new_mixer
from pointkit.compiling import compiled_in_place, inlined
from puck.experts import (
    FINE,
    Experts,
    begin,
    first_scales,
    learn,
    narrow,
    new_experts,
    write_logits,
)
from puck.least_squares import LeastSquares, learn_target, new_least_squares, predicted, solve
from puck.numbers import halves
from puck.ranges import PAD

_EXPERTS = 4
_CONTEXTS = 9
_LEAN_CONTEXTS = 5
"""Number of contexts of a lean model, which has no experts."""
_LEVELS = 12
_FEATURES = 14
_TREE = 256


class ReflectivityModel(NamedTuple):
    same: Mixer  # of the decision whether a guess is right
    value: Mixer  # of the bits of a value
    starts: Ints  # first counter of each context of `value`
    experts: Experts
    linear: LeastSquares
    empty: Ints  # for each laser: 1 + the value of its last firing without a return,
    error: Ints  # the running mean of its errors, in 1 / FINE,
    was_same: Ints  # a bit for each of the last guesses that was right
    memory: Ints  # number of returns


class ReflectivityContext(NamedTuple):
    """Reflectivities of a turn, and arrays that predict them, all (PAD + columns, lasers)."""

    values: Words  # an encoder reads them, a decoder writes them
    held: Words  # 1 + the value of the laser's last return up to this column
    ranges: Words  # 0 for no return
    then: Words  # reflectivities and ranges of the previous turn
    then_ranges: Words
    guesses: Words  # 1 + the value that is guessed, or 0


def new_reflectivity_model(bits: BitCoder, lasers: int, lean: bool = False) -> ReflectivityModel:
    """Return a model that has learnt nothing yet.

    With `lean`, the model has few contexts and takes a quarter of the time.
    """
    sizes = np.array([lasers * 2, 257, 257, 32 * 33, 32 * 32, 257, 32 * 33, 256 * 5, 16 * 33])
    sizes *= _TREE
    zeros = np.zeros(lasers, np.int64)
    experts, contexts, sets = (0, _LEAN_CONTEXTS, 1) if lean else (_EXPERTS, _CONTEXTS, 2)
    return ReflectivityModel(
        new_mixer(bits, MixerOptions(
            contexts=3, counters=lasers * 32 + lasers * 16 + 1024, rows=16, weights=[0.4] * 3,
        )),
        new_mixer(bits, MixerOptions(
            experts=experts, contexts=contexts, counters=int(sizes.sum()),
            rows=_TREE + 9 * _LEVELS, weights=[0.3 if lean else 0.2] * (experts + contexts),
            final_learning_rate=2, sets=sets,
        )),
        np.cumsum(sizes) - sizes,
        new_experts(np.tile(first_scales(_LEVELS, 4), (_EXPERTS, 1)), _EXPERTS),
        new_least_squares(1, _FEATURES),
        zeros, zeros + 8 * FINE, zeros.copy(),
        np.zeros(1, np.int64),
    )  # fmt: skip


@compiled_in_place
def code_reflectivities(model: ReflectivityModel, turn: ReflectivityContext, nearest: Ints) -> bool:
    """Encode or decode the reflectivities of a turn, and return False if the stream ends early.

    The argument `nearest` is that of `ranges.code_ranges`.
    """
    values, held = turn.values, turn.held
    for c in range(PAD, len(values)):
        for laser in range(values.shape[1]):
            returned = turn.ranges[c, laser] > 0
            guess = int(turn.guesses[c, laser])
            if guess == 0 and not returned:
                guess = int(model.empty[laser])
            is_same = 0
            if guess > 0:
                is_same = _code_same(model, turn, c, laser, guess)
            if is_same == 1:
                values[c, laser] = guess - 1
            else:
                values[c, laser] = _code_byte(model, turn, c, laser, nearest[c - PAD], guess)
            if returned:
                held[c, laser] = values[c, laser] + 1
            else:
                held[c, laser] = held[c - 1, laser]
                model.empty[laser] = values[c, laser] + 1
        if exhausted(model.same.bits):
            return False
    return True


@inlined
def _code_same(
    model: ReflectivityModel, turn: ReflectivityContext, c: int, laser: int, guess: int
) -> int:
    same = model.same
    returned = 1 if turn.ranges[c, laser] > 0 else 0
    west = 1 if turn.ranges[c - 1, laser] > 0 else 0
    history = model.was_same[laser] & 7
    lasers = turn.values.shape[1]
    same.contexts[0] = laser * 32 + history * 4 + returned * 2 + west
    same.contexts[1] = lasers * 32 + laser * 16 + history * 2 + returned
    same.contexts[2] = lasers * 48 + (guess & 255) * 2 + returned
    same.rows[0] = history * 2 + returned
    bit = code_bit(same, 1 if turn.values[c, laser] == guess - 1 else 0, 0, 0)
    model.was_same[laser] = model.was_same[laser] << 1 & 7 | bit
    return bit


@inlined
def _code_byte(
    model: ReflectivityModel, turn: ReflectivityContext, c: int, laser: int, t: int, guess: int
) -> int:
    held, mixer, starts = turn.held, model.value, model.starts
    west, west2 = int(held[c - 1, laser]), int(held[c - 2, laser])
    below = int(held[c, laser - 1]) if laser > 0 else 0
    then = 0
    if t > 0 and turn.then_ranges[t, laser] > 0:
        then = int(turn.then[t, laser]) + 1
    returned = 1 if turn.ranges[c, laser] > 0 else 0
    at, west_value = mixer.contexts, max(west - 1, 0)
    at[0] = starts[0] + (laser * 2 + returned) * _TREE
    at[1] = starts[1] + west * _TREE
    at[2] = starts[2] + then * _TREE
    at[3] = starts[3] + ((west_value >> 3) * 33 + ((then + 7) >> 3)) * _TREE
    at[4] = starts[4] + ((west_value >> 3) * 32 + (max(west2 - 1, 0) >> 3)) * _TREE
    if len(mixer.sizes.contexts) < _CONTEXTS:
        return _code_lean(mixer, int(turn.values[c, laser]))
    _write_features(model, turn, c, laser, t, west)
    means = model.experts.means
    first = predicted(model.linear, 0)
    means[0] = max(FINE * west_value + first, 1) if west > 0 else 0
    means[1] = FINE * (then - 1) + 1 if then > 0 else 0
    means[2] = FINE * (west - 1) + 1 if west > 0 else 0
    means[3] = FINE * (guess - 1) + 1 if guess > 0 else 0
    level = min(max(halves(model.error[laser]) - 4, 0), _LEVELS - 1)
    begin(model.experts, level)
    at[5] = starts[5] + below * _TREE
    at[6] = starts[6] + ((west_value >> 3) * 33 + ((below + 7) >> 3)) * _TREE
    at[7] = starts[7] + (west_value * 5 + _change(turn, c, laser)) * _TREE
    at[8] = starts[8] + (level * 33 + min(max(means[0] // (8 * FINE), 0), 32)) * _TREE
    node, low, high, depth = 1, 0, 256, 0
    while high - low > 1:
        middle = (low + high) >> 1
        write_logits(model.experts, FINE * middle - FINE // 2, mixer.inputs)
        mixer.rows[0] = node
        mixer.rows[1] = _TREE + depth * _LEVELS + level
        bit = code_bit(mixer, int(turn.values[c, laser] >= middle), node, 0)
        narrow(model.experts, bit)
        low, high = (middle, high) if bit == 1 else (low, middle)
        node, depth = 2 * node + bit, depth + 1
    learn(model.experts, level, FINE * low, 6)
    if returned == 1 and west > 0:
        _learn_linear(model, FINE * (low - west + 1), first, laser)
    return low


@inlined
def _code_lean(mixer: Mixer, value: int) -> int:
    node = 1
    for depth in range(7, 3, -1):
        node = 2 * node + code_bit(mixer, value >> depth & 1, node, node)
    # The counters of the low bits lie side by side, in one or two lines of the cache.
    first, below = 15 * node - 225, 1
    for depth in range(3, -1, -1):
        bit = code_bit(mixer, value >> depth & 1, first + below, node)
        node, below = 2 * node + bit, 2 * below + bit
    return node - 256


@inlined
def _learn_linear(model: ReflectivityModel, target: int, first: int, laser: int) -> None:
    error = min(abs(target - first), 4000)
    model.error[laser] += (error - model.error[laser]) >> 2
    if error < 60 * FINE:
        damp = max(halves(error) - 6, 0) >> 1
        learn_target(model.linear, 0, target, damp, 11)
        model.memory[0] += 1
        if model.memory[0] % 8 == 0:
            solve(model.linear, 0)


@inlined
def _change(turn: ReflectivityContext, c: int, laser: int) -> int:
    """Return the level, 1 to 4, of the range's change since the last column; 0 if unknown."""
    now, before = turn.ranges[c, laser], turn.ranges[c - 1, laser]
    if now == 0 or before == 0:
        return 0
    change = abs(now - before)
    return 1 if change < 4 else 2 if change < 10 else 3 if change < 40 else 4


@inlined
def _write_features(
    model: ReflectivityModel, turn: ReflectivityContext, c: int, laser: int, t: int, west: int
) -> None:
    x, held = model.linear.features, turn.held
    for k in range(4):
        x[k] = _difference(held[c - 2 - k, laser], west)
    for k in range(4, _FEATURES):
        x[k] = 0
    if laser > 0:
        x[4] = _difference(held[c, laser - 1], west)
        x[5] = _difference(held[c - 1, laser - 1], west)
    if laser + 1 < held.shape[1]:
        x[6] = _difference(held[c - 1, laser + 1], west)
    if t > 0:
        for k in range(5):
            if turn.then_ranges[t - 2 + k, laser] > 0:
                x[7 + k] = _difference(turn.then[t - 2 + k, laser] + 1, west)
        if laser > 0 and turn.then_ranges[t, laser - 1] > 0 and turn.ranges[c, laser - 1] > 0:
            x[12] = _difference(held[c, laser - 1], turn.then[t, laser - 1] + 1)
    x[13] = 4


@inlined
def _difference(later: int, earlier: int) -> int:
    return FINE * min(max(later - earlier, -60), 60) if later > 0 and earlier > 0 else 0

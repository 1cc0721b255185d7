"""Coding of a number as binary decisions around an expected value, the centre.

The first decision says on which side of the centre the number is. The next decisions compare it
with thresholds at growing distances from the centre. Finally, the interval between the last two
thresholds is halved repeatedly. The numbers of a small interval are taken for equally likely.
"""

from __future__ import annotations

import numpy as np

from pointkit.coding.binary_coder import MIN_PROBABILITY, ONE, code, code_uniform
from pointkit.coding.context_mixing import (
    CERTAINTY,
    COUNT_BITS,
    PROBABILITY_BITS,
    Mixer,
    Words,
    code_bit,
    learn_bit,
)
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import inlined
from puck.experts import FINE, Experts, narrow, write_logits

NODES = 64
"""Number of kinds of decisions, each with separate contexts and weights."""
_STEPS = 11
_LATER_HALVINGS = 62


@inlined
def code_number(
    mixer: Mixer, experts: Experts, number: int, centre: int, unit: int, step: int, farthest: int,
    smooth: int, start: int = -1,
) -> int:  # fmt: skip
    """Encode or decode a number from 0 to (farthest + step) // step, and return the number.

    Parameters
    ----------
    mixer
        Mixes the experts' probabilities; it holds the arithmetic encoder or decoder.
    experts
        Experts, which estimate `step` * `number`.
    number
        The number to encode. A decoder ignores it.
    centre
        Expected number, at least 1.
    unit
        Distance of the first threshold from the centre.
    step, farthest
        Quantisation step, and largest value before quantisation.
    smooth
        Largest interval whose numbers are coded as equally likely; 1 for none. With `start`, it is
        halved once more before, by an adaptive counter.
    start
        Index of the first of `NODES` counters of the mixer, one for each kind of decision, or -1.
        They replace the mixture in the last halving and, without experts, in all decisions.
    """
    is_unmixed = len(experts.every) == 0  # a constant: the compiler removes the other branch
    low, high = 0, in_steps(farthest, step) + 2
    side, steps, reach = 0, 0, 0
    if centre < high:
        side = _decide(mixer, experts, is_unmixed, start, number, centre, 0, step)
        low, high = (centre, high) if side == 1 else (low, centre)
    while True:
        steps += 1
        reach = unit * steps if steps < 4 else unit * (2 + (steps & 1)) << (steps >> 1) >> 1
        middle = centre + reach if side == 1 else centre - reach
        if middle <= low or middle >= high:
            break
        node = 1 + side * _STEPS + min(steps - 1, _STEPS - 1)
        bit = _decide(mixer, experts, is_unmixed, start, number, middle, node, step)
        low, high = (middle, high) if bit == 1 else (low, middle)
        if bit != side:
            break
    node = 1 + (2 + side) * _STEPS + min(steps - 1, _STEPS - 1)
    while high - low > smooth:
        middle = (low + high) >> 1
        bit = _decide(mixer, experts, is_unmixed, start, number, middle, node, step)
        low, high = (middle, high) if bit == 1 else (low, middle)
        node = _LATER_HALVINGS
    if start >= 0 and high - low > 1:
        middle = (low + high) >> 1
        bit = code_unmixed_bit(mixer, start + node, int(number >= middle))
        low, high = (middle, high) if bit == 1 else (low, middle)
    return low + code_uniform(mixer.bits, number - low, high - low) if high - low > 1 else low


@inlined
def _decide(
    mixer: Mixer, experts: Experts, is_unmixed: bool, start: int, number: int, middle: int,
    node: int, step: int,
) -> int:  # fmt: skip
    bit = int(number >= middle)
    if is_unmixed:
        return code_unmixed_bit(mixer, start + node, bit)
    edge = FINE * step * middle - FINE * step // 2
    write_logits(experts, edge, mixer.inputs)
    bit = code_bit(mixer, bit, node, node)
    narrow(experts, bit)
    return bit


@inlined
def code_unmixed_bit(mixer: Mixer, counter: int, bit: int) -> int:
    """Encode or decode a bit by a single counter of the mixer, and return the bit."""
    state = np.int64(mixer.counters[np.uint64(counter)])
    share = int(state >> COUNT_BITS + PROBABILITY_BITS - 16)
    bit = code(mixer.bits, bit, min(max(share, MIN_PROBABILITY), ONE - MIN_PROBABILITY))
    learn_bit(mixer.counters, counter, bit * CERTAINTY, mixer.rates, mixer.memory)
    return bit


@inlined
def in_steps(number: int, step: int) -> int:
    """Return how many whole steps of size `step` a number contains."""
    return number if step == 1 else number // step


@inlined
def halves(value: int) -> int:
    """Return the level of a number >= 0 on a logarithmic scale with two levels per octave."""
    value += 1
    k: int = 63 - leading_zeros(value)
    return 2 * k + ((value >> (k - 1)) & 1 if k > 0 else 0)


@inlined
def level_of_value(value: int, centre: int, unit: int) -> int:
    """Return the level (see `level_of`) of `value` - `centre`, or 9 if the value is 0."""
    return level_of(value - centre, unit) if value > 0 else 9


@inlined
def activity(
    error: int, errors: Words, then: Words, c: int, laser: int, t: int, levels: int
) -> int:
    """Return the level, from 0 to `levels` - 1, of the prediction errors around a pixel.

    Parameters
    ----------
    error
        Mean error of the pixel's laser, in units of 1 / FINE.
    errors, then
        Errors of this turn and of the previous turn, (columns, lasers).
    c, laser
        Column and laser of the pixel.
    t
        Row of the nearest column in the previous turn, or 0 if there is none.
    levels
        Number of levels.
    """
    total = 2 * error
    total += errors[c, laser - 1] if laser > 0 else error
    total += errors[c - 1, laser + 1] if laser + 1 < errors.shape[1] else error
    if t > 0:
        total += 2 * then[t, laser] + then[t + 1, laser] + then[t - 1, laser]
    else:
        total += 4 * error
    return min(max(halves(total >> 3) - 6, 0), levels - 1)


@inlined
def level_of(difference: int, unit: int) -> int:
    """Return the level, 0 to 8, of a signed difference in units of `unit`; 4 means nearly 0."""
    size = abs(difference)
    if 2 * size < unit:
        return 4
    level = 1
    if 2 * size >= 3 * unit:
        level = 2 if size < 3 * unit else 3 if size < 8 * unit else 4
    return 4 + level if difference > 0 else 4 - level

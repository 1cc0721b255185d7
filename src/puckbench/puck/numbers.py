"""A number as binary decisions around a centre, each mixed of experts and contexts."""

from __future__ import annotations

import numpy as np

from puckbench.coding.binary_coder import LEAST, ONE, code
from puckbench.coding.context_mixing import CERTAIN, FINE_BITS, SEEN_BITS, learn_bit
from puckbench.coding.leading_zeros import leading_zeros
from puckbench.core.compiling import inlined
from puckbench.puck.experts import FINE, Experts, ask, tell
from puckbench.puck.mixing import Mixer, code_bit

FARTHEST = (1 << 16) - 1
"""The largest range of a packet."""
NODES = 64
"""Decisions that contexts and weights tell apart."""
_STEPS = 11
_DEEP = 62


@inlined
def code_number(
    mixer: Mixer, experts: Experts, number: int, centre: int, unit: int, step: int
) -> int:
    """Code a number by its side of `centre`, steps away from there that grow, and halvings.

    Parameters
    ----------
    mixer
        Its `at` and `rows` are those of node 0.
    experts
        Their means are `step` times as large as the numbers.
    number
        0 to (FARTHEST + step) // step.
    centre
        At least 1.
    unit
        Length of the first steps.
    step
        The experts' unit in the number's.
    """
    return _traverse(mixer, experts, False, 0, number, centre, unit, step)


@inlined
def code_plain_number(
    mixer: Mixer, experts: Experts, start: int, number: int, centre: int, unit: int, step: int
) -> int:
    """Code a number as `code_number` does, by the counters from `start` on alone."""
    return _traverse(mixer, experts, True, start, number, centre, unit, step)


@inlined
def _traverse(
    mixer: Mixer, experts: Experts, is_plain: bool, start: int, number: int, centre: int, unit: int,
    step: int,
) -> int:  # fmt: skip
    """Code a number's decisions, from its side of the centre down to an interval of itself.

    is_plain: whether by counters from `start` on; the compiler folds it, being constant in the
    callers.
    """
    low, high = 0, in_steps(FARTHEST, step) + 2
    side, steps, reach = 0, 0, 0
    if centre < high:
        side = _decide(mixer, experts, is_plain, start, number, centre, 0, step)
        low, high = (centre, high) if side == 1 else (low, centre)
    while True:
        steps += 1
        reach = unit * steps if steps < 4 else unit * (2 + (steps & 1)) << (steps >> 1) >> 1
        middle = centre + reach if side == 1 else centre - reach
        if middle <= low or middle >= high:
            break
        node = 1 + side * _STEPS + min(steps - 1, _STEPS - 1)
        bit = _decide(mixer, experts, is_plain, start, number, middle, node, step)
        low, high = (middle, high) if bit == 1 else (low, middle)
        if bit != side:
            break
    node = 1 + (2 + side) * _STEPS + min(steps - 1, _STEPS - 1)
    while high - low > 1:
        middle = (low + high) >> 1
        bit = _decide(mixer, experts, is_plain, start, number, middle, node, step)
        low, high = (middle, high) if bit == 1 else (low, middle)
        node = _DEEP
    return low


@inlined
def _decide(
    mixer: Mixer, experts: Experts, is_plain: bool, start: int, number: int, middle: int, node: int,
    step: int,
) -> int:  # fmt: skip
    """Code whether the number is at least `middle`."""
    bit = int(number >= middle)
    if is_plain:
        return code_plain_bit(mixer, start + node, bit)
    edge = FINE * step * middle - FINE * step // 2
    ask(experts, edge, mixer.inputs)
    bit = code_bit(mixer, bit, node, node)
    tell(experts, bit)
    return bit


@inlined
def code_plain_bit(mixer: Mixer, counter: int, bit: int) -> int:
    """Code a bit by one adaptive probability, without mixing."""
    state = np.int64(mixer.counters[np.uint64(counter)])
    share = int(state >> SEEN_BITS + FINE_BITS - 16)
    bit = code(mixer.bits, bit, min(max(share, LEAST), ONE - LEAST))
    learn_bit(mixer.counters, counter, bit * CERTAIN, mixer.rates, mixer.pace[2])
    return bit


@inlined
def in_steps(number: int, step: int) -> int:
    """A number by a step, rounded down; without loss that is no division."""
    return number if step == 1 else number // step


@inlined
def halves(value: int) -> int:
    """Place of a number of at least 0 in a scale of two steps an octave."""
    value += 1
    k: int = 63 - leading_zeros(value)
    return 2 * k + ((value >> (k - 1)) & 1 if k > 0 else 0)


@inlined
def level_of(difference: int, unit: int) -> int:
    """A signed difference in units, on nine levels: 4 for almost none."""
    size = abs(difference)
    if 2 * size < unit:
        return 4
    level = 1
    if 2 * size >= 3 * unit:
        level = 2 if size < 3 * unit else 3 if size < 8 * unit else 4
    return 4 + level if difference > 0 else 4 - level

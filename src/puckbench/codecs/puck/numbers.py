"""A number as binary decisions around a centre, each mixed of experts and contexts."""

from __future__ import annotations

import numpy as np

from puckbench.codecs.common.binary_coder import LEAST, ONE, code
from puckbench.codecs.puck.experts import FINE, Experts, ask, tell
from puckbench.codecs.puck.mixing import Mixer, code_bit
from puckbench.core.compiling import inlined

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
    low, high = 0, FARTHEST // step + 2
    side, steps, reach = 0, 0, 0
    if centre < high:
        side = _decide(mixer, experts, number, centre, 0, step)
        low, high = (centre, high) if side == 1 else (low, centre)
    while True:
        steps += 1
        reach = unit * steps if steps < 4 else unit * (2 + (steps & 1)) << (steps >> 1) >> 1
        middle = centre + reach if side == 1 else centre - reach
        if middle <= low or middle >= high:
            break
        node = 1 + side * _STEPS + min(steps - 1, _STEPS - 1)
        bit = _decide(mixer, experts, number, middle, node, step)
        low, high = (middle, high) if bit == 1 else (low, middle)
        if bit != side:
            break
    node = 1 + (2 + side) * _STEPS + min(steps - 1, _STEPS - 1)
    while high - low > 1:
        middle = (low + high) >> 1
        bit = _decide(mixer, experts, number, middle, node, step)
        low, high = (middle, high) if bit == 1 else (low, middle)
        node = _DEEP
    return low


@inlined
def _decide(mixer: Mixer, experts: Experts, number: int, middle: int, node: int, step: int) -> int:
    """Code whether the number is at least `middle`."""
    edge = FINE * step * middle - FINE * step // 2
    ask(experts, edge, mixer.inputs)
    _move(mixer, node)
    bit = code_bit(mixer, 1 if number >= middle else 0)
    _move(mixer, -node)
    tell(experts, edge, bit)
    return bit


@inlined
def _move(mixer: Mixer, nodes: int) -> None:
    for k in range(len(mixer.at)):
        mixer.at[k] += nodes
    for k in range(len(mixer.rows)):
        mixer.rows[k] += nodes


@inlined
def code_plain_bit(mixer: Mixer, counter: int, bit: int) -> int:
    """Code a bit by one adaptive probability, without mixing."""
    state = np.int64(mixer.counters[counter])
    count, probability = state & 511, state >> 9
    share = int(probability >> 6)
    bit = code(mixer.bits, bit, min(max(share, LEAST), ONE - LEAST))
    probability += ((bit * ((1 << 22) - 1) - probability) * mixer.rates[count]) >> 16
    mixer.counters[counter] = probability << 9 | min(count + 1, mixer.pace[2])
    return bit


@inlined
def code_plain_number(
    mixer: Mixer, start: int, number: int, centre: int, unit: int, step: int
) -> int:
    """Code a number as `code_number` does, by the counters from `start` on alone."""
    low, high = 0, FARTHEST // step + 2
    side, steps, reach = 0, 0, 0
    if centre < high:
        side = code_plain_bit(mixer, start, 1 if number >= centre else 0)
        low, high = (centre, high) if side == 1 else (low, centre)
    while True:
        steps += 1
        reach = unit * steps if steps < 4 else unit * (2 + (steps & 1)) << (steps >> 1) >> 1
        middle = centre + reach if side == 1 else centre - reach
        if middle <= low or middle >= high:
            break
        node = 1 + side * _STEPS + min(steps - 1, _STEPS - 1)
        bit = code_plain_bit(mixer, start + node, 1 if number >= middle else 0)
        low, high = (middle, high) if bit == 1 else (low, middle)
        if bit != side:
            break
    node = 1 + (2 + side) * _STEPS + min(steps - 1, _STEPS - 1)
    while high - low > 1:
        middle = (low + high) >> 1
        bit = code_plain_bit(mixer, start + node, 1 if number >= middle else 0)
        low, high = (middle, high) if bit == 1 else (low, middle)
        node = _DEEP
    return low


@inlined
def halves(value: int) -> int:
    """Place of a number of at least 0 in a scale of two steps an octave."""
    value += 1
    k = 0
    while value >> (k + 1):
        k += 1
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

"""Choice of prediction modes: each node uses the mode with the lowest estimated cost.

Costs have single precision, as in TMC13, so that mode decisions are equal.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gpcc.compiled import entry, integer
from gpcc.fixed_point import int32
from gpcc.kd_tree import Int32s
from gpcc.predictive import (
    CTX_NUM_BITS,
    CTX_PHI_GT,
    CTX_PRED_MODE,
    CTX_RES_GT0,
    CTX_RESIDUAL_PHI,
    CTX_SIGN,
    CTX_SIGN_PHI,
    LINEAR3,
    NONE,
    Tools,
    predicted,
)
from gpcc.spherical import halved_away
from gpcc.syntax import Three
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import inlined

_COSTS = (-np.log2(np.maximum(np.arange(129), 1) / 128.0)).astype(np.float32)
_MOST_COST = np.float32(np.finfo(np.float32).max)
_RECIPROCALS = np.rint((1 << 20) * 8 / np.arange(8, 16)).astype(np.int64)


class Choice(NamedTuple):
    mode: int
    steps: int
    residual: Three


@entry
def quantised(value: int, qp: int) -> int:
    """Divide a residual by a QP's step size, and round."""
    return integer((value * (_RECIPROCALS[qp & 7] >> (qp >> 3)) + (1 << 19)) >> 20)


@inlined
def decide(
    coder: Any, tools: Tools, positions: Int32s, node: int, before: Three
) -> tuple[bool, Choice]:
    """Return whether a node's residual fits into a stream, and the mode with the lowest cost.

    before: the node's ancestors.
    """
    best = _predict(tools, positions, node, before, NONE)
    fits = _is_representable(tools, best.residual)
    least = _cost(coder, tools, best) if fits else _MOST_COST
    for mode in range(1, LINEAR3 + 1):
        if before[mode - 1] < 0:
            break
        choice = _predict(tools, positions, node, before, mode)
        if _is_representable(tools, choice.residual):
            cost = _cost(coder, tools, choice)
            if cost < least:
                best, least, fits = choice, cost, True
    return fits, best


@inlined
def _predict(tools: Tools, positions: Int32s, node: int, before: Three, mode: int) -> Choice:
    a, b, c = predicted(positions, before, mode, tools)
    first, second, third = (
        integer(positions[node, 0]),
        integer(positions[node, 1]),
        integer(positions[node, 2]),
    )
    if not tools.angular:
        residual = (
            quantised(first - a, tools.slice_qp),
            quantised(second - b, tools.slice_qp),
            quantised(third - c, tools.slice_qp),
        )
        return Choice(mode, 0, residual)
    half = tools.azimuth_speed >> 1
    turned = second - b
    steps = (abs(turned) + half) // tools.azimuth_speed
    if turned < 0:
        steps = -steps
    arc = second - int32(b + steps * tools.azimuth_speed)
    if tools.azimuth_scaling:
        arc = int32(halved_away((arc * first) << 3, tools.sphere.azimuth_log2))
    return Choice(mode, steps, (first - a, arc, third - c))


@inlined
def _is_representable(tools: Tools, residual: Three) -> bool:
    for axis in range(3):
        bits = (1 << tools.resid_abs_log2_bits[axis]) - 1
        if residual[axis] and (abs(residual[axis]) - 1) >> min(bits, 31):
            return False
    return True


@inlined
def _bit_cost(coder: Any, context: int, bit: int) -> Any:
    zero = max(1, integer(coder.contexts[context]) >> 9)
    return _COSTS[128 - zero if bit else zero]


@inlined
def _cost(coder: Any, tools: Tools, choice: Choice) -> Any:
    mode, residual = choice.mode, choice.residual
    bits = _bit_cost(coder, CTX_PRED_MODE, mode >> 1)
    bits += _bit_cost(coder, CTX_PRED_MODE + 1 + (mode >> 1), mode & 1)
    if tools.angular:
        bits = _with_steps(coder, choice.steps, bits)
    group = 0
    for axis in range(3):
        if axis == 2 and tools.angular and len(tools.sphere.theta) == 1:
            break
        value = residual[axis]
        bits += _bit_cost(coder, CTX_RES_GT0 + axis, integer(value != 0))
        if value == 0:
            continue
        if mode or axis:
            bits += _bit_cost(coder, CTX_SIGN + axis, integer(value < 0))
        length = 64 - leading_zeros(abs(value) - 1)
        node, start = integer(1), CTX_NUM_BITS + 31 * (3 * group + axis) - 1
        for k in range(tools.resid_abs_log2_bits[axis] - 1, -1, -1):
            bit = length >> k & 1
            bits += _bit_cost(coder, start + node, bit)
            node = node << 1 | bit
        if axis == 0 and not tools.angular:
            group = min(4, (length + 1) >> 1)
        bits += np.float32(max(0, length - 1))
    return bits


@inlined
def _with_steps(coder: Any, steps: int, bits: Any) -> Any:
    bits += _bit_cost(coder, CTX_PHI_GT, integer(steps != 0))
    if steps == 0:
        return bits
    value = abs(steps) - 1
    bits += _bit_cost(coder, CTX_PHI_GT + 1, integer(value > 0))
    bits += _bit_cost(coder, CTX_SIGN_PHI, integer(steps < 0))
    if value == 0:
        return bits
    low, rest = min(value - 1, 7), value - 8
    node = integer(1)
    for k in range(2, -1, -1):
        bits += _bit_cost(coder, CTX_RESIDUAL_PHI + node - 1, low >> k & 1)
        node = node << 1 | (low >> k & 1)
    if rest >= 0:
        bits = np.float32(np.float64(bits) + (1.0 + 2.0 * math.log2(rest + 1)))
    return bits

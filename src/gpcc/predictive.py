"""Predictive geometry (`geom_tree_type` 1): prediction of points, and coding of syntax elements.

Points are nodes of trees, coded in depth-first order. Each point is predicted from up to three
ancestors, and corrected by a residual. Angular coding predicts in spherical coordinates; a second
residual corrects x, y and z. An encoder chooses the mode of prediction with the lowest estimated
cost. Costs have single precision, as in TMC13, so that the choices are the same. In TMC13:
`PredGeomEncoder`, `PredGeomDecoder`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gpcc.arithmetic import (
    HALF,
    Probabilities,
    code_bit,
    code_bypass,
    code_count,
    code_exp_golomb,
    code_exp_golomb_in_contexts,
)
from gpcc.compiled import entry, integer, kernel, row
from gpcc.fixed_point import int32
from gpcc.kd_tree import Int32s
from gpcc.spherical import Sphere, halved_away
from gpcc.syntax import Three
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import inlined

NONE, _DELTA, LINEAR2, LINEAR3 = range(4)
"""Modes of prediction of a point.

They use no ancestor, the parent, a line through two ancestors, and a parallelogram of three.
"""

# Indices into probabilities; a comment states the number of contexts if there are several.
CTX_NUM_CHILDREN = integer(0)  # 3
CTX_PRED_MODE = integer(3)  # 3
CTX_RES_GT0 = integer(6)  # 3 axes
CTX_SIGN = integer(9)  # 3 axes
CTX_NUM_DUP_POINTS_GT0 = integer(12)
CTX_NUM_DUP_POINTS = integer(13)
CTX_RESIDUAL2_GT = integer(14)  # 2 x 3 axes
CTX_SIGN2 = integer(20)  # 3 axes
CTX_EG2_PREFIX = integer(23)  # 3 axes x 5
CTX_EG2_SUFFIX = integer(38)  # 3 axes x 4
CTX_QP_OFFSET_ABS_GT0 = integer(50)
CTX_QP_OFFSET_SIGN = integer(51)
CTX_QP_OFFSET_ABS_EGL = integer(52)
CTX_PHI_GT = integer(53)  # 2
CTX_SIGN_PHI = integer(55)
CTX_EG_PHI = integer(56)
CTX_RESIDUAL_PHI = integer(57)  # 7
CTX_END_OF_TREES = integer(64)
CTX_NUM_BITS = integer(65)  # 5 x 3 axes x 31
# Each axis has contexts for 5-bit numbers. TMC13's header allows 6 or 7 bits, whose last bits use
# the contexts that follow.
_COUNT = 65 + 5 * 3 * 31 + (1 << 7)

_COSTS = (-np.log2(np.maximum(np.arange(129), 1) / 128.0)).astype(np.float32)
_MOST_COST = np.float32(np.finfo(np.float32).max)
_RECIPROCALS = np.rint((1 << 20) * 8 / np.arange(8, 16)).astype(np.int64)

MOST_QP = 223
"""Maximum quantisation parameter (QP), whose step size has 31 bits."""


class Tools(NamedTuple):
    """Coding tools of a slice; the fields have the names of the syntax elements."""

    unique_points: bool
    angular: bool
    azimuth_scaling: bool
    azimuth_speed: int
    min_radius: int
    resid_abs_log2_bits: Three
    scaling: bool
    qp_multiplier_log2: int
    slice_qp: int
    qp_interval: int
    sphere: Sphere


def initial_probabilities() -> Probabilities:
    return np.full(_COUNT, HALF, dtype=np.uint16)


@inlined
def code_num_dup_points(coder: Any, count: int) -> int:
    return code_count(coder, CTX_NUM_DUP_POINTS_GT0, CTX_NUM_DUP_POINTS, count)


@inlined
def code_num_children(coder: Any, count: int) -> int:
    """Encode or decode a number of children: one bit for 1, two for 0, three for 2 or 3."""
    value = count ^ 1
    if not code_bit(coder, CTX_NUM_CHILDREN, integer(value > 0)):
        return 1
    if not code_bit(coder, CTX_NUM_CHILDREN + 1, integer(value > 1)):
        return 0
    return 3 - code_bit(coder, CTX_NUM_CHILDREN + 2, integer(value > 2))


@inlined
def code_pred_mode(coder: Any, mode: int) -> int:
    high = code_bit(coder, CTX_PRED_MODE, mode >> 1)
    return high << 1 | code_bit(coder, CTX_PRED_MODE + 1 + high, mode & 1)


@kernel
def code_phi_multiplier(coder: Any, multiplier: int) -> int:
    """Encode or decode how many times `azimuth_speed` is added to the predicted azimuth."""
    if not code_bit(coder, CTX_PHI_GT, integer(multiplier != 0)):
        return 0
    value = abs(multiplier) - 1
    if code_bit(coder, CTX_PHI_GT + 1, integer(value > 0)):
        value = 1 + _code_phi_rest(coder, value - 1)
    else:
        value = 0
    negative = code_bit(coder, CTX_SIGN_PHI, integer(multiplier < 0))
    return -(value + 1) if negative else value + 1


@kernel
def _code_phi_rest(coder: Any, value: int) -> int:
    low = min(value, 7)
    node = integer(1)
    for k in range(2, -1, -1):
        node = node << 1 | code_bit(coder, CTX_RESIDUAL_PHI + node - 1, low >> k & 1)
    if node != 15:
        return node - 8
    return 7 + code_exp_golomb(coder, CTX_EG_PHI, value - 7)


@kernel
def code_qp_offset(coder: Any, offset: int) -> int:
    """Encode or decode the next nodes' offset of the QP, in units of 2^`qp_multiplier_log2`."""
    # TMC13 writes the sign before the magnitude but reads it after; our encoder writes only 0.
    size = code_count(coder, CTX_QP_OFFSET_ABS_GT0, CTX_QP_OFFSET_ABS_EGL, abs(offset))
    if size == 0:
        return 0
    return -size if code_bit(coder, CTX_QP_OFFSET_SIGN, integer(offset < 0)) else size


@inlined
def code_residual(coder: Any, tools: Tools, mode: int, residual: Three) -> Three:
    first, bits = _code_component(coder, tools, 0, 0, residual[0], mode != 0)
    group = 0 if tools.angular else min(4, (bits + 1) >> 1)
    second, _ = _code_component(coder, tools, 1, group, residual[1], True)
    if tools.angular and len(tools.sphere.theta) == 1:
        return first, second, 0
    third, _ = _code_component(coder, tools, 2, group, residual[2], True)
    return first, second, third


@inlined
def _code_component(
    coder: Any, tools: Tools, axis: int, group: int, value: int, signed: bool
) -> tuple[int, int]:
    if not code_bit(coder, CTX_RES_GT0 + axis, integer(value != 0)):
        return 0, 0
    magnitude = abs(value) - 1
    bits = code_num_bits(coder, tools.resid_abs_log2_bits[axis], 3 * group + axis, magnitude)
    rest = 0
    for k in range(bits - 1):
        rest |= code_bypass(coder, magnitude >> k & 1) << k
    size = 1 + (rest | 1 << (bits - 1) if bits else 0)
    negative = signed and code_bit(coder, CTX_SIGN + axis, integer(value < 0)) != 0
    return (-size if negative else size), bits


@inlined
def code_num_bits(coder: Any, width: int, group: int, magnitude: int) -> int:
    """Encode or decode a magnitude's bit length as a number of `width` bits, highest bit first."""
    bits = 64 - leading_zeros(magnitude)
    node = integer(1)
    start = CTX_NUM_BITS + 31 * group - 1
    for k in range(width - 1, -1, -1):
        node = node << 1 | code_bit(coder, start + node, bits >> k & 1)
    return node ^ 1 << width


@inlined
def code_residual2(coder: Any, residual: Three) -> Three:
    return (
        _code_component2(coder, 0, residual[0]),
        _code_component2(coder, 1, residual[1]),
        _code_component2(coder, 2, residual[2]),
    )


@inlined
def _code_component2(coder: Any, axis: int, value: int) -> int:
    if not code_bit(coder, CTX_RESIDUAL2_GT + axis, integer(value != 0)):
        return 0
    size = 1
    if code_bit(coder, CTX_RESIDUAL2_GT + 3 + axis, integer(abs(value) > 1)):
        prefix, suffix = CTX_EG2_PREFIX + 5 * axis, CTX_EG2_SUFFIX + 4 * axis
        size = 2 + code_exp_golomb_in_contexts(coder, prefix, 4, suffix, 3, abs(value) - 2, 0)
    return -size if code_bit(coder, CTX_SIGN2 + axis, integer(value < 0)) else size


@inlined
def scaled(value: int, qp: int) -> int:
    """Return a quantised number times the step size of a QP, (1 + (QP mod 8) / 8) 2^(QP div 8)."""
    return int32((value * ((8 + (qp & 7)) << (qp >> 3)) + 4) >> 3)


@inlined
def ancestors(parents: Int32s, node: int) -> Three:
    first = integer(parents[node])
    second = integer(parents[first]) if first >= 0 else -1
    third = integer(parents[second]) if second >= 0 else -1
    return first, second, third


@inlined
def predicted(positions: Int32s, before: Three, mode: int, tools: Tools) -> Three:
    """Return the position (3,) that a mode predicts from the ancestors of a node.

    Parameters
    ----------
    positions
        Coordinates (n, 3) of all nodes.
    before
        Indices of three ancestors, the parent first. Those that the mode uses must exist.
    mode
        Mode of prediction.
    tools
        Coding tools of the slice.
    """
    a, b, c = before
    if mode == NONE:
        if not tools.angular:
            return 0, 0, 0
        if a < 0:
            return tools.min_radius, 0, 0
        return tools.min_radius, integer(positions[a, 1]), integer(positions[a, 2])
    x, y, z = row(positions, a)
    if mode == LINEAR2:
        p, q, r = row(positions, b)
        return int32(2 * x - p), int32(2 * y - q), int32(2 * z - r)
    if mode == LINEAR3:
        p, q, r = row(positions, b)
        u, v, w = row(positions, c)
        return int32(x + p - u), int32(y + q - v), int32(z + r - w)
    return x, y, z


class Choice(NamedTuple):
    mode: int
    steps: int
    residual: Three


@entry
def quantised(value: int, qp: int) -> int:
    """Return a residual divided by the step size of a QP, and rounded."""
    return integer((value * (_RECIPROCALS[qp & 7] >> (qp >> 3)) + (1 << 19)) >> 20)


@inlined
def quantised_residual(residual: Three, qp: int) -> Three:
    return quantised(residual[0], qp), quantised(residual[1], qp), quantised(residual[2], qp)


@inlined
def decide(
    coder: Any, tools: Tools, positions: Int32s, node: int, before: Three
) -> tuple[bool, Choice]:
    """Choose how an encoder predicts a node.

    Parameters
    ----------
    coder
        The arithmetic encoder, whose probabilities give the costs.
    tools
        Coding tools of the slice.
    positions
        Coordinates (n, 3) of all nodes.
    node
        Index of the node.
    before
        Indices of three ancestors of the node, -1 where there is none.

    Returns
    -------
    fits
        Whether the residual fits into the number of bits that the stream allows.
    choice
        The mode with the lowest estimated cost.
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
    first, second, third = row(positions, node)
    if not tools.angular:
        values = (first - a, second - b, third - c)
        return Choice(mode, 0, quantised_residual(values, tools.slice_qp))
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

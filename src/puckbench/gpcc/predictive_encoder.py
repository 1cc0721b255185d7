"""Encoding of prediction trees: each node uses the mode with the lowest estimated cost.

Costs have single precision, as in TMC13, so that mode decisions are equal.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import inlined
from puckbench.gpcc.arithmetic import code_bit
from puckbench.gpcc.compiled import entry, integer
from puckbench.gpcc.fixed_point import int32
from puckbench.gpcc.prediction_tree import ROOT, PredictionTree
from puckbench.gpcc.predictive import (
    CTX_END_OF_TREES,
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
    ancestors,
    code_num_children,
    code_num_dup_points,
    code_phi_multiplier,
    code_pred_mode,
    code_qp_offset,
    code_residual,
    code_residual2,
    predicted,
    scaled,
)
from puckbench.gpcc.spherical import azimuth_of_arc, cartesian, halved_away
from puckbench.gpcc.syntax import Three

DONE, FULL, UNREPRESENTABLE = 0, 1, 2
"""Results of `encode_trees`: all trees are coded; the buffer is full; a residual has more bits
than the slice header allows.
"""

NODE_BYTES = 600
"""Maximum number of bytes of a node: about 500 coded bits of at most a byte each."""

_COSTS = (-np.log2(np.maximum(np.arange(129), 1) / 128.0)).astype(np.float32)
_MOST_COST = np.float32(np.finfo(np.float32).max)
_RECIPROCALS = np.rint((1 << 20) * 8 / np.arange(8, 16)).astype(np.int64)


class EncoderState(NamedTuple):
    """Data to encode; during encoding, decoded values replace `points` and `positions`.

    positions: (n, 3) coordinates to predict: `points`, or spherical coordinates.
    stack: nodes to code next.
    progress: (4,) next root; numbers of nodes on the stack, of nodes until the next QP offset, and
        of coded points.
    order: (n,) result: indices of the points in coded order.
    """

    tree: PredictionTree
    points: NDArray[np.int32]
    positions: NDArray[np.int32]
    stack: NDArray[np.int32]
    progress: NDArray[np.int64]
    order: NDArray[np.int32]


class Choice(NamedTuple):
    mode: int
    steps: int
    prediction: Three
    residual: Three


@entry
def encode_trees(coder: Any, tools: Tools, state: EncoderState) -> int:
    """Encode all trees, or continue after FULL; return DONE, FULL or UNREPRESENTABLE."""
    progress, parents = state.progress, state.tree.parents
    while True:
        fault = _encode_tree(coder, tools, state)
        if fault != DONE:
            return fault
        while progress[0] < len(parents) and parents[progress[0]] != ROOT:
            progress[0] += 1
        more = progress[0] < len(parents)
        if progress[3]:
            code_bit(coder, CTX_END_OF_TREES, integer(not more))
        if not more:
            return DONE
        state.stack[0] = progress[0]
        progress[0] += 1
        progress[1] = 1
        progress[2] = 0


@inlined
def _encode_tree(coder: Any, tools: Tools, state: EncoderState) -> int:
    tree, progress = state.tree, state.progress
    while progress[1]:
        if coder.state[3] + NODE_BYTES > len(coder.data):
            return FULL
        progress[1] -= 1
        node = integer(state.stack[progress[1]])
        if tools.scaling:
            if progress[2] == 0:
                code_qp_offset(coder, 0)
                progress[2] = tools.qp_interval
            progress[2] -= 1
        if not tools.unique_points:
            code_num_dup_points(coder, integer(tree.copies[node]))
        code_num_children(coder, integer(tree.num_children[node]))
        if not _encode_position(coder, tools, state, node):
            return UNREPRESENTABLE
        for k in range(node, node + 1 + tree.copies[node]):
            state.order[progress[3]] = k
            progress[3] += 1
            for axis in range(3):
                state.points[k, axis] = state.points[node, axis]
                state.positions[k, axis] = state.positions[node, axis]
        for k in range(tree.num_children[node]):
            state.stack[progress[1]] = tree.children[node, k]
            progress[1] += 1
    return DONE


@inlined
def _encode_position(coder: Any, tools: Tools, state: EncoderState, node: int) -> bool:
    fits, choice = _decided(coder, tools, state, node)
    if not fits:
        return False
    code_pred_mode(coder, choice.mode)
    if tools.angular:
        code_phi_multiplier(coder, choice.steps)
    code_residual(coder, tools, choice.mode, choice.residual)
    if tools.angular:
        _encode_place(coder, tools, state, node, choice)
        return True
    for axis in range(3):
        exact = choice.prediction[axis] + scaled(choice.residual[axis], tools.slice_qp)
        state.points[node, axis] = max(0, exact)
    return True


@inlined
def _encode_place(coder: Any, tools: Tools, state: EncoderState, node: int, choice: Choice) -> None:
    around, positions = tools.sphere, state.positions
    if tools.azimuth_scaling:
        radius = choice.prediction[0] + choice.residual[0]
        turned = azimuth_of_arc(choice.residual[1], radius, around.azimuth_log2)
        positions[node, 0] = radius
        positions[node, 1] = choice.prediction[1] + turned
        positions[node, 2] = choice.prediction[2] + choice.residual[2]
    place = cartesian(
        around,
        integer(positions[node, 0]),
        integer(positions[node, 1]),
        integer(positions[node, 2]),
    )
    qp, origin, points = tools.slice_qp, around.origin, state.points
    second = code_residual2(
        coder,
        (
            quantised(points[node, 0] - origin[0] - place[0], qp),
            quantised(points[node, 1] - origin[1] - place[1], qp),
            quantised(points[node, 2] - origin[2] - place[2], qp),
        ),
    )
    for axis in range(3):
        points[node, axis] = max(0, origin[axis] + place[axis] + scaled(second[axis], qp))


@entry
def quantised(value: int, qp: int) -> int:
    """Divide a residual by a QP's step size, and round."""
    return integer((value * (_RECIPROCALS[qp & 7] >> (qp >> 3)) + (1 << 19)) >> 20)


@inlined
def _decided(coder: Any, tools: Tools, state: EncoderState, node: int) -> tuple[bool, Choice]:
    before = ancestors(state.tree.parents, node)
    best = _predict(tools, state, node, before, NONE)
    fits = _is_representable(tools, best.residual)
    least = _cost(coder, tools, best) if fits else _MOST_COST
    for mode in range(1, LINEAR3 + 1):
        if before[mode - 1] < 0:
            break
        choice = _predict(tools, state, node, before, mode)
        if _is_representable(tools, choice.residual):
            cost = _cost(coder, tools, choice)
            if cost < least:
                best, least, fits = choice, cost, True
    return fits, best


@inlined
def _predict(tools: Tools, state: EncoderState, node: int, before: Three, mode: int) -> Choice:
    positions = state.positions
    a, b, c = predicted(positions, before, mode, tools)
    first, second, third = (
        integer(positions[node, 0]),
        integer(positions[node, 1]),
        integer(positions[node, 2]),
    )
    steps = 0
    if not tools.angular:
        residual = (
            quantised(first - a, tools.slice_qp),
            quantised(second - b, tools.slice_qp),
            quantised(third - c, tools.slice_qp),
        )
        return Choice(mode, steps, (a, b, c), residual)
    half = tools.azimuth_speed >> 1
    turned = second - b
    steps = (abs(turned) + half) // tools.azimuth_speed
    if turned < 0:
        steps = -steps
    b = int32(b + steps * tools.azimuth_speed)
    arc = second - b
    if tools.azimuth_scaling:
        arc = int32(halved_away((arc * first) << 3, tools.sphere.azimuth_log2))
    return Choice(mode, steps, (a, b, c), (first - a, arc, third - c))


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
        length = 0
        while abs(value) - 1 >> length > 0:
            length += 1
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

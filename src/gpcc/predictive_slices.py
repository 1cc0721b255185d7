from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpcc.arithmetic import Probabilities, code_bit, consumed, encoder, enlarged, exhausted, finish
from gpcc.compiled import entry, integer, row
from gpcc.fixed_point import int32
from gpcc.kd_tree import Int32s
from gpcc.prediction_tree import ROOT, PredictionTree
from gpcc.predictive import (
    CTX_END_OF_TREES,
    MOST_QP,
    NONE,
    Choice,
    Tools,
    ancestors,
    code_num_children,
    code_num_dup_points,
    code_phi_multiplier,
    code_pred_mode,
    code_qp_offset,
    code_residual,
    code_residual2,
    decide,
    predicted,
    quantised_residual,
    scaled,
)
from gpcc.slices import CodedSlice, sensor_position, slice_decoder
from gpcc.spherical import azimuth_of_arc, cartesian, sphere
from gpcc.syntax import GeometryHeader, GeometryParameterSet, SequenceParameterSet, Three
from pointkit.compiling import inlined
from pointkit.errors import InputError
from pointkit.geometry.morton import Ints

DONE, FULL, UNREPRESENTABLE, EXHAUSTED, TOO_MANY_POINTS, DAMAGED = range(6)
"""Results of coding the trees of a slice.

The encoder or decoder has coded all trees (DONE); the encoder's buffer is full (FULL); a residual
has more bits than the slice header allows (UNREPRESENTABLE). The other results are faults of a
damaged stream.
"""
_FAULTS = {
    TOO_MANY_POINTS: "a slice holds more points than it says",
    EXHAUSTED: "a slice's data are damaged or truncated",
    DAMAGED: "a slice's data are damaged or truncated",
}
_MOST_INTERVAL_LOG2 = 30
_NODE_BYTES = 600
"""Maximum number of bytes of a node, which has about 500 coded bits of at most a byte each."""


class TreeNodes(NamedTuple):
    """Nodes (n,) of the prediction trees of a slice.

    While an encoder runs, decoded points replace its points.
    """

    # (n, 3). A decoder's points have coding order.
    points: Int32s
    # (n, 3) coordinates to predict: `points`, or spherical coordinates.
    positions: Int32s
    parents: Int32s
    # Nodes to encode next, or parents of the nodes to decode next.
    stack: Int32s
    # (4,) an encoder's next root; numbers of nodes on the stack, of nodes until the next QP offset,
    # and of coded points.
    progress: Ints
    # (n,) indices of an encoder's points in coding order.
    order: Int32s


@entry
def _code_trees(coder: Any, tools: Tools, nodes: TreeNodes, tree: PredictionTree | None) -> int:
    # After a call that returned FULL, since the output was full, the next call continues.
    progress, parents = nodes.progress, nodes.parents
    while True:
        result = _code_tree(coder, tools, nodes, tree)
        if result != DONE:
            return result
        more, root = True, integer(ROOT)
        if tree is not None:
            while progress[0] < len(parents) and parents[progress[0]] != ROOT:
                progress[0] += 1
            root = progress[0]
            more = root < len(parents)
        if progress[3]:
            more = not code_bit(coder, CTX_END_OF_TREES, integer(not more))
        if not more:
            return DONE
        nodes.stack[0] = root
        progress[0], progress[1], progress[2] = root + 1, 1, 0


@inlined
def _code_tree(coder: Any, tools: Tools, nodes: TreeNodes, tree: PredictionTree | None) -> int:
    progress, qp = nodes.progress, tools.slice_qp
    pending, done = progress[1], progress[3]
    while pending:
        result = _fault(coder, nodes, tree, done)
        if result != DONE:
            progress[1], progress[3] = pending, done
            return result
        pending -= 1
        node, copies, children = _next_node(nodes, tree, pending, done)
        if tools.scaling:
            qp = _code_qp(coder, tools, progress, qp)
            if qp < 0 or qp > MOST_QP:
                return DAMAGED
        if not tools.unique_points:
            copies = code_num_dup_points(coder, copies)
        children = code_num_children(coder, children)
        if done + 1 + copies + pending + children > len(nodes.parents):
            return TOO_MANY_POINTS
        result = _code_position(coder, tools, nodes, tree, node, qp)
        if result != DONE:
            return result
        done = _finish(nodes, node, copies, done)
        for k in range(children):
            nodes.stack[pending] = tree.children[node, k] if tree is not None else node
            pending += 1
    progress[1], progress[3] = 0, done
    return DONE


@inlined
def _fault(coder: Any, nodes: TreeNodes, tree: PredictionTree | None, done: int) -> int:
    if tree is not None and coder.state[3] + _NODE_BYTES > len(coder.data):
        return FULL
    if done >= len(nodes.parents):
        return TOO_MANY_POINTS
    return EXHAUSTED if exhausted(coder) else DONE


@inlined
def _next_node(
    nodes: TreeNodes, tree: PredictionTree | None, pending: int, done: int
) -> tuple[int, int, int]:
    """Return the next node and, in an encoder, its numbers of copies and children."""
    node = integer(nodes.stack[pending])
    if tree is not None:
        return node, integer(tree.copies[node]), integer(tree.num_children[node])
    nodes.parents[done] = node
    return done, integer(0), integer(0)


@inlined
def _code_qp(coder: Any, tools: Tools, progress: Ints, qp: int) -> int:
    if progress[2] == 0:
        qp = tools.slice_qp + (code_qp_offset(coder, 0) << tools.qp_multiplier_log2)
        progress[2] = tools.qp_interval
    progress[2] -= 1
    return qp


@inlined
def _finish(nodes: TreeNodes, node: int, copies: int, done: int) -> int:
    """Write the duplicates of a node's point, and return the number of points coded so far."""
    if len(nodes.order):
        for k in range(copies + 1):
            nodes.order[done + k] = node + k
    for k in range(node + 1, node + 1 + copies):
        for axis in range(3):
            nodes.points[k, axis] = nodes.points[node, axis]
            nodes.positions[k, axis] = nodes.positions[node, axis]
    return done + 1 + copies


@inlined
def _code_position(
    coder: Any, tools: Tools, nodes: TreeNodes, tree: PredictionTree | None, node: int, qp: int
) -> int:
    points, positions, before = nodes.points, nodes.positions, ancestors(nodes.parents, node)
    choice = Choice(NONE, 0, (0, 0, 0))
    if tree is not None:
        fits, choice = decide(coder, tools, positions, node, before)
        if not fits:
            return UNREPRESENTABLE
    mode = code_pred_mode(coder, choice.mode)
    if mode > 0 and before[mode - 1] < 0:
        return DAMAGED
    steps = code_phi_multiplier(coder, choice.steps) if tools.angular else 0
    r = code_residual(coder, tools, mode, choice.residual)
    p = predicted(positions, before, mode, tools)
    if not tools.angular:
        _write_corrected(points, node, p, r, qp)
        return DONE
    radius, turned, laser = int32(p[0] + r[0]), r[1], p[2] + r[2]
    if tools.azimuth_scaling:
        turned = azimuth_of_arc(r[1], radius, tools.sphere.azimuth_log2)
    azimuth = int32(p[1] + steps * tools.azimuth_speed + turned)
    if laser < 0 or laser >= len(tools.sphere.theta):
        return DAMAGED
    positions[node, 0], positions[node, 1], positions[node, 2] = radius, azimuth, laser
    a, b, c = cartesian(tools.sphere, radius, azimuth, laser)
    a, b, c = a + tools.sphere.origin[0], b + tools.sphere.origin[1], c + tools.sphere.origin[2]
    second = (integer(0), integer(0), integer(0))
    if tree is not None:
        x, y, z = row(points, node)
        second = quantised_residual((x - a, y - b, z - c), qp)
    _write_corrected(points, node, (a, b, c), code_residual2(coder, second), qp)
    return DONE


@inlined
def _write_corrected(points: Int32s, node: int, p: Three, residual: Three, qp: int) -> None:
    points[node, 0] = max(0, int32(p[0] + scaled(residual[0], qp)))
    points[node, 1] = max(0, int32(p[1] + scaled(residual[1], qp)))
    points[node, 2] = max(0, int32(p[2] + scaled(residual[2], qp)))


def decode_trees(
    coded: CodedSlice,
    sps: SequenceParameterSet,
    gps: GeometryParameterSet,
    contexts: Probabilities,
    axes: Three,
    origin: Three,
) -> TreeNodes:
    tools = tools_of(coded.header, gps, axes, origin)
    coder = slice_decoder(contexts, coded, sps)
    points = np.empty((coded.points, 3), dtype=np.int32)
    positions = np.empty_like(points) if tools.angular else points
    nodes = _tree_nodes(points, positions, np.empty(coded.points, dtype=np.int32), points[:0, 0])
    result = _code_trees(coder, tools, nodes, None)
    if result == DONE and consumed(coder) > coder.state[4]:
        result = EXHAUSTED
    if result != DONE:
        raise InputError(f"G-PCC stream: {_FAULTS[result]}")
    if nodes.progress[3] != coded.points:
        raise InputError("G-PCC stream: a slice holds fewer points than it says")
    return nodes


def _tree_nodes(points: Int32s, positions: Int32s, parents: Int32s, order: Int32s) -> TreeNodes:
    stack = np.empty(len(points) + 2, dtype=np.int32)
    return TreeNodes(points, positions, parents, stack, np.zeros(4, dtype=np.int64), order)


def placed(points: Int32s, axes: Three, origin: Three) -> Ints:
    """Return points (n, 3) of the coded axes as x, y and z, with `origin` added."""
    result: Ints = points.astype(np.int64)[:, axes]
    result += origin
    return result


def tools_of(
    header: GeometryHeader, gps: GeometryParameterSet, axes: Three, origin: Three
) -> Tools:
    """Return the coding tools of a slice from the slice's header and the parameter set.

    Parameters
    ----------
    header, gps
        Header of the slice, and geometry parameter set.
    axes
        Indices of x, y and z among the coded axes.
    origin
        Origin of the slice.

    Raises
    ------
    InputError
        The header and the parameter set contradict each other, or the tools are not supported.
    """
    multiplier = gps.geom_qp_multiplier_log2
    slice_qp = (gps.geom_base_qp + header.geom_slice_qp_offset) << multiplier
    if not 0 <= slice_qp <= MOST_QP:
        raise InputError("G-PCC stream: the header of a slice is damaged")
    # TMC13 writes a negative difference as an unsigned 32-bit number.
    interval = (gps.geom_qp_offset_intvl_log2 + header.geom_qp_offset_intvl_log2_delta) % (1 << 32)
    return Tools(
        unique_points=bool(gps.geom_unique_points_flag),
        angular=bool(gps.geom_angular_mode_enabled_flag),
        azimuth_scaling=bool(gps.azimuth_scaling_enabled_flag),
        azimuth_speed=gps.geom_angular_azimuth_speed_minus1 + 1,
        min_radius=header.pgeom_min_radius,
        resid_abs_log2_bits=header.pgeom_resid_abs_log2_bits,
        scaling=bool(gps.geom_scaling_enabled_flag),
        qp_multiplier_log2=multiplier,
        slice_qp=slice_qp,
        qp_interval=1 << min(interval, _MOST_INTERVAL_LOG2),
        sphere=sphere(gps, sensor_position(header, gps, axes, origin)),
    )


def encode_trees(
    tree: PredictionTree,
    points: Int32s,
    positions: Int32s,
    tools: Tools,
    contexts: Probabilities,
    order: Int32s,
) -> bytes | None:
    """Encode the prediction trees of a slice.

    Parameters
    ----------
    tree
        Parents and children of the points.
    points
        Coordinates (n, 3), which are replaced by the decoded ones.
    positions
        Coordinates (n, 3) that are predicted: `points`, or spherical coordinates. They are
        replaced, too.
    tools
        Coding tools of the slice.
    contexts
        Initial probabilities.
    order
        Result (n,): indices of the points in coding order.

    Returns
    -------
    bytes or None
        The arithmetic-coded bytes; None if a residual has more bits than `tools` allow.
    """
    nodes = _tree_nodes(points, positions, tree.parents, order)
    coder, result = encoder(contexts, _NODE_BYTES + 4 * len(points)), FULL
    while result == FULL:
        result = _code_trees(coder, tools, nodes, tree)
        coder = enlarged(coder, _NODE_BYTES + len(coder.data))
    return finish(coder) if result == DONE else None

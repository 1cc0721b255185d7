"""Planar mode, which states that a node's occupied children lie in one of two planes along an axis.

The mode is used for nodes with few occupied children, along axes on which it is frequent
(`OctreePlanarState`, `OctreePlanarBuffer` of TMC13).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.arithmetic import code_bit
from gpcc.compiled import integer, kernel
from gpcc.contexts import (
    CTX_PLANAR_MODE,
    CTX_PLANE_ANGULAR,
    CTX_PLANE_ANGULAR_PHI,
    CTX_PLANE_LAST_INDEX,
    CTX_PLANE_LAST_INDEX_Z,
)
from gpcc.neighbours import AFTER, BEFORE, UPPER
from pointkit.coding.intrinsics import bit_count
from pointkit.compiling import inlined
from pointkit.geometry.morton import compact_bits

_ROWS = 1 << 14
_MAX_DENSITY = 3 * 1024
_NO_NODE = -2
_ADJACENT_PLANES_CTX = np.array([0, 1, 2, 0], dtype=np.int64)


class PlanarState(NamedTuple):
    """Adaptive rates of planar modes, and a buffer with the last planes."""

    enabled: bool
    buffered: bool
    # Rates of planar nodes along x, y, z, in units of 1/2048; mean number of occupied children, in
    # units of 1/1024.
    rates: NDArray[np.int64]
    # Minimum rates of the most, second most and least planar axis.
    thresholds: NDArray[np.int64]
    # position, plane_index: (3, rows) for each coordinate along an axis: last node's position
    # perpendicular to the axis, and this node's only occupied plane (negative: none).
    position: NDArray[np.int64]
    plane_index: NDArray[np.int64]


def planar_state(
    enabled: bool, buffered: bool, depth: int, thresholds: tuple[int, int, int]
) -> PlanarState:
    rows = min(_ROWS, 1 << depth) if enabled and buffered else 1
    return PlanarState(
        enabled,
        buffered,
        np.array([1024, 1024, 1024, 4096], dtype=np.int64),
        np.array(thresholds, dtype=np.int64) << 4,
        np.zeros((3, rows), dtype=np.int64),
        np.full((3, rows), _NO_NODE, dtype=np.int64),
    )


def reset_planar_buffer(state: PlanarState, rows: int) -> None:
    state.position[:, :rows] = 0
    state.plane_index[:, :rows] = _NO_NODE


@inlined
def update_planar_rates(state: PlanarState, occupancy: int) -> None:
    rates = state.rates
    for axis in range(3):
        planar_mode = (occupancy & UPPER[axis] == 0) or (occupancy & ~UPPER[axis] & 0xFF == 0)
        rates[axis] = (255 * rates[axis] + (2048 if planar_mode else 0) + 128) >> 8
    rates[3] = (255 * rates[3] + 1024 * bit_count(occupancy)) >> 8


@inlined
def planar_eligible_axes(state: PlanarState, axes: int) -> int:
    """Return the mask of axes (1 x, 2 y, 4 z) along which planes are frequent enough to be coded.

    The mask `axes` (4 x, 2 y, 1 z) holds the axes along which the node is split.
    """
    rates = state.rates
    if rates[3] >= _MAX_DENSITY:
        return 0
    result = 0
    for axis in range(3):
        rank = 0
        for other in range(3):
            ahead = rates[other] > rates[axis] or (rates[other] == rates[axis] and other < axis)
            rank += integer(ahead)
        if rates[axis] >= state.thresholds[rank] and axes >> (2 - axis) & 1:
            result |= 1 << axis
    return result


@kernel
def planar_mode_of(occupancy: int) -> tuple[int, int]:
    """Return two masks of axes (1 x, 2 y, 4 z) that describe the planes of an occupancy.

    The first mask has the axes along which only one of the two planes of children is occupied; the
    second has those of these axes along which the upper plane is occupied.
    """
    planar_mode, plane_pos_bits = 0, 0
    for axis in range(3):
        high = occupancy & UPPER[axis] != 0
        low = occupancy & ~UPPER[axis] & 0xFF != 0
        if high != low:
            planar_mode |= 1 << axis
            plane_pos_bits |= integer(high) << axis
    return planar_mode, plane_pos_bits


@inlined
def planar_mask(planar_mode: int, plane_pos_bits: int, axis: int) -> int:
    if planar_mode >> axis & 1 == 0:
        return 0
    return integer(UPPER[axis] ^ 0xFF if plane_pos_bits >> axis & 1 else UPPER[axis])


class PlanarNode(NamedTuple):
    """Neighbourhood of a node, which selects contexts of the node's planar modes."""

    morton: int
    child: int
    sibling_occupancy: int
    neigh_pattern: int
    # Occupancies of the neighbours x-1, y-1, z-1, one byte each.
    adjacent_occupancies: int
    adjacent_known: bool
    # Contexts along x, y, z; see `angular.PlaneAngles`.
    angles: tuple[int, int, int]


@inlined
def code_planar_modes(
    coder: Any, state: PlanarState, node: PlanarNode, eligible_axes: int, occupancy: int
) -> tuple[int, int, int]:
    """Encode or decode the planar modes of a node along the eligible axes.

    Returns
    -------
    planar_mode, plane_pos_bits
        The two masks of `planar_mode_of`.
    planar_possible
        Mask for `PlanarMasks.planar_possible`.
    """
    planar_mode, plane_pos_bits, planar_possible = 0, 0, 7
    if eligible_axes == 0:
        return planar_mode, plane_pos_bits, planar_possible
    mode, pos_bits = planar_mode_of(occupancy)
    for axis in range(3):
        if eligible_axes >> axis & 1 == 0:
            continue
        plane = _code_planar_mode(coder, state, node, axis, mode >> axis & 1, pos_bits >> axis & 1)
        if plane < 0:
            planar_possible &= ~(1 << axis)
        else:
            planar_mode |= 1 << axis
            plane_pos_bits |= plane << axis
    return planar_mode, plane_pos_bits, planar_possible


@inlined
def _code_planar_mode(
    coder: Any,
    state: PlanarState,
    node: PlanarNode,
    axis: int,
    planar_mode: int,
    plane_pos_bits: int,
) -> int:
    """Encode or decode the only occupied plane along an axis, or -1 if both are occupied."""
    row, position, far_ctx, last_plane = 0, 0, 0, -1
    if state.buffered:
        row = compact_bits(node.morton >> (2 - axis)) & (_ROWS - 1)
        other = compact_bits(node.morton >> (1 if axis == 0 else 2))
        another = compact_bits(node.morton >> (1 if axis == 2 else 0))
        position = max(other >> 3 & 31, another >> 3 & 31)
        far_ctx = 2 * integer(abs(position - state.position[axis, row]) > 1)
        last_plane = state.plane_index[axis, row]
    plane = integer(-1)
    if code_bit(coder, CTX_PLANAR_MODE + axis, planar_mode):
        if node.angles[axis] >= 0:
            context = CTX_PLANE_ANGULAR if axis == 2 else CTX_PLANE_ANGULAR_PHI
            context += node.angles[axis]
        else:
            adjacent_ctx = _adjacent_planes_ctx(node, axis)
            if last_plane < 0:
                context = CTX_PLANE_LAST_INDEX_Z + adjacent_ctx
            else:
                context = CTX_PLANE_LAST_INDEX + 12 * axis + 4 * adjacent_ctx
                context += last_plane + far_ctx
        plane = code_bit(coder, context, plane_pos_bits)
    state.rates[axis] = (255 * state.rates[axis] + (2048 if plane >= 0 else 0) + 128) >> 8
    if state.buffered:
        state.position[axis, row] = position
        state.plane_index[axis, row] = plane
    return plane


@inlined
def _adjacent_planes_ctx(node: PlanarNode, axis: int) -> int:
    before, after = BEFORE[axis], AFTER[axis]
    if node.adjacent_known:
        low = node.adjacent_occupancies >> (8 * axis) & UPPER[axis] != 0
    else:
        low = node.neigh_pattern >> before & 1 != 0
    if node.child >> (2 - axis) & 1:
        high = node.neigh_pattern >> after & 1 != 0
    else:
        high = node.sibling_occupancy & UPPER[axis] != 0
    return integer(_ADJACENT_PLANES_CTX[integer(high) << 1 | integer(low)])

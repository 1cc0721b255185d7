"""Planar mode: whether all children of a node lie in one of the two planes of an axis, and which.

It is tried only along axes where planes have been frequent of late, and where nodes are sparse.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.gpcc.arithmetic import code_bit
from puckbench.codecs.gpcc.compiled import integer, kernel
from puckbench.codecs.gpcc.models import PLANAR_MODE, PLANE, PLANE_UNKNOWN, Models
from puckbench.codecs.gpcc.neighbours import AFTER, BEFORE, UPPER
from puckbench.codecs.gpcc.tables import COUNT
from puckbench.core.compiling import inlined
from puckbench.geometry.morton import gathered

_ROWS = 1 << 14
_DENSEST = 3 * 1024
_UNUSED = -2
_CONTEXT_OF_NEIGHBOURS = np.array([0, 1, 2, 0], dtype=np.int64)


class PlanarState(NamedTuple):
    """Rates and buffers of planar coding.

    enabled: whether there is any. rates: of planes along x, y, z, and the density of nodes.
    thresholds: rates from which the most, second and least frequent axis are tried. place, plane:
    (3, rows) for each axis and position along it, where the last planar node was and its plane.
    """

    enabled: bool
    rates: NDArray[np.int64]
    thresholds: NDArray[np.int64]
    place: NDArray[np.int64]
    plane: NDArray[np.int64]


def planar_state(enabled: bool, depth: int, thresholds: tuple[int, int, int]) -> PlanarState:
    """The state at the start of a slice, a tree of `depth` levels."""
    rows = min(_ROWS, 1 << depth) if enabled else 1
    return PlanarState(
        enabled,
        np.array([1024, 1024, 1024, 4096], dtype=np.int64),
        np.array(thresholds, dtype=np.int64) << 4,
        np.zeros((3, rows), dtype=np.int64),
        np.full((3, rows), _UNUSED, dtype=np.int64),
    )


def forget_planes(state: PlanarState, rows: int) -> None:
    """Empty the buffers' first rows, those of a level with so many positions along an axis."""
    state.place[:, :rows] = 0
    state.plane[:, :rows] = _UNUSED


@kernel
def count_planes(state: PlanarState, occupancy: int) -> None:
    """Take the occupancy of the parent of the next nodes into the rates."""
    rates = state.rates
    for axis in range(3):
        planar = (occupancy & UPPER[axis] == 0) or (occupancy & ~UPPER[axis] & 0xFF == 0)
        rates[axis] = (255 * rates[axis] + (2048 if planar else 0) + 128) >> 8
    rates[3] = (255 * rates[3] + 1024 * COUNT[occupancy]) >> 8


@kernel
def eligible_axes(state: PlanarState, axes: int) -> int:
    """The axes (1 x, 2 y, 4 z) to try, of those split (4 x, 2 y, 1 z)."""
    rates = state.rates
    if rates[3] >= _DENSEST:
        return 0
    found = 0
    for axis in range(3):
        rank = 0
        for other in range(3):
            ahead = rates[other] > rates[axis] or (rates[other] == rates[axis] and other < axis)
            rank += integer(ahead)
        if rates[axis] >= state.thresholds[rank] and axes >> (2 - axis) & 1:
            found |= 1 << axis
    return found


@kernel
def planes_of(occupancy: int) -> tuple[int, int]:
    """Axes (1 x, 2 y, 4 z) along which only one plane is occupied; those where it is the upper."""
    planar, upper = 0, 0
    for axis in range(3):
        high = occupancy & UPPER[axis] != 0
        low = occupancy & ~UPPER[axis] & 0xFF != 0
        if high != low:
            planar |= 1 << axis
            upper |= integer(high) << axis
    return planar, upper


@inlined
def masked_children(planar: int, upper: int, axis: int) -> int:
    """Children known empty because the occupied plane of an axis is known."""
    if planar >> axis & 1 == 0:
        return 0
    return integer(UPPER[axis] ^ 0xFF if upper >> axis & 1 else UPPER[axis])


class Node(NamedTuple):
    """What planar coding goes by: a node's code, its place in the parent and the parent's
    occupancy, its neighbour pattern, the occupancies of x-1, y-1, z-1 (a byte each) and whether
    these are known.
    """

    morton: int
    child: int
    siblings: int
    pattern: int
    seen: int
    known: bool


@kernel
def code_planes(
    coder: Any, models: Models, state: PlanarState, node: Node, eligible: int, occupancy: int
) -> tuple[int, int, int]:
    """Code the planes of a node along the eligible axes.

    Returns, as masks of axes (1 x, 2 y, 4 z): planar ones, those whose upper plane is occupied,
    and those not known to have both planes occupied.
    """
    planar, upper, possible = 0, 0, 7
    if eligible == 0:
        return planar, upper, possible
    given, given_upper = planes_of(occupancy)
    for axis in range(3):
        if eligible >> axis & 1 == 0:
            continue
        plane = _code_plane(
            coder, models, state, node, axis, given >> axis & 1, given_upper >> axis & 1
        )
        if plane < 0:
            possible &= ~(1 << axis)
        else:
            planar |= 1 << axis
            upper |= plane << axis
    return planar, upper, possible


@kernel
def _code_plane(
    coder: Any,
    models: Models,
    state: PlanarState,
    node: Node,
    axis: int,
    planar: int,
    upper: int,
) -> int:
    """Code whether a node is planar along an axis and which plane is occupied; -1 if not."""
    row = gathered(node.morton >> (2 - axis)) & (_ROWS - 1)
    other = gathered(node.morton >> (1 if axis == 0 else 2))
    another = gathered(node.morton >> (1 if axis == 2 else 0))
    place = max(other >> 3 & 31, another >> 3 & 31)
    near = 2 * integer(abs(place - state.place[axis, row]) > 1)
    last = state.plane[axis, row]
    plane = integer(-1)
    if code_bit(coder, models.probabilities, PLANAR_MODE + axis, planar):
        beside = _planes_beside(node, axis)
        model = PLANE_UNKNOWN + beside if last < 0 else PLANE + 12 * axis + 4 * beside + last + near
        plane = code_bit(coder, models.probabilities, model, upper)
    state.rates[axis] = (255 * state.rates[axis] + (2048 if plane >= 0 else 0) + 128) >> 8
    state.place[axis, row] = place
    state.plane[axis, row] = plane
    return plane


@kernel
def _planes_beside(node: Node, axis: int) -> int:
    """Context by which of the planes next to a node's two are occupied."""
    before, after = BEFORE[axis], AFTER[axis]
    if node.known:
        low = node.seen >> (8 * axis) & UPPER[axis] != 0
    else:
        low = node.pattern >> before & 1 != 0
    if node.child >> (2 - axis) & 1:
        high = node.pattern >> after & 1 != 0
    else:
        high = node.siblings & UPPER[axis] != 0
    return integer(_CONTEXT_OF_NEIGHBOURS[integer(high) << 1 | integer(low)])

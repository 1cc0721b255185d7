"""Which columns of a leaf's plane are surface: a bitmap, coded in the context of its surroundings.

A column is one cell wide, seen along the plane's dominant axis. The columns of all leaves share a
grid of cells, so that a bitmap goes on where the neighbouring leaf's ended.
"""

from __future__ import annotations

import numpy as np

from puckbench.codecs.primitives.columns import Choice, choose, gain_at
from puckbench.codecs.primitives.entropy import Coder, code_bit
from puckbench.codecs.primitives.layout import (
    Bytes,
    Frame,
    Ints,
    Leaves,
    Owners,
    dominant,
    height,
    owner_at,
)
from puckbench.codecs.primitives.traversal import CONTEXTS as TREE_CONTEXTS
from puckbench.codecs.primitives.traversal import MIXERS as TREE_MIXERS
from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats

# States of a column, also in the grid of cells.
_UNKNOWN, _EMPTY, _SURFACE = 0, 1, 2
MOST_COLUMNS = 256
"""Columns across the largest leaf."""

_FACES = TREE_CONTEXTS
_AROUND = _FACES + 81 * 9
_COUNTS = _AROUND + 6561
CONTEXTS = _COUNTS + 16 * 9
_MIXER = TREE_MIXERS
MIXERS = TREE_MIXERS + 1


@compiled
def code_support(
    coder: Coder, frame: Frame, leaves: Leaves, owner: Owners, choice: Choice, cover: Bytes
) -> None:
    """Code the bitmaps of all leaves into `cover`: the state of each cell that a column ends in.

    A leaf of one cell is all surface. choice: what the encoder decides by.
    """
    for i in range(leaves.counts[0]):
        if leaves.side[i] == 1:
            cell = leaves.corner[i]
            cover[cell[0], cell[1], cell[2]] = _SURFACE
    bits = np.zeros((MOST_COLUMNS, MOST_COLUMNS), np.uint8)
    for i in range(leaves.counts[0]):
        side = leaves.side[i]
        if side == 1:
            continue
        if coder.bits.registers[4] == 1:
            _choose_columns(frame, leaves, i, owner, cover, choice, bits[:side, :side])
        _code_columns(coder, frame, leaves, i, owner, bits[:side, :side], cover)


@compiled_in_place
def cell_of(frame: Frame, plane: Floats, axis: int, a: int, b: int, at: Ints) -> bool:
    """Write the cell in which a plane crosses a column's middle; false outside the grid."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    if a < 0 or b < 0 or a >= frame.shape[u] or b >= frame.shape[v]:
        return False
    place = height(plane, axis, a + 0.5, b + 0.5)
    if not 0 <= place < frame.shape[axis]:
        return False
    at[axis], at[u], at[v] = int(place), a, b
    return True


@compiled_in_place
def in_leaf(frame: Frame, leaves: Leaves, i: int, axis: int, a: int, b: int, at: Ints) -> bool:
    """Whether the plane of leaf i crosses column (a, b) within the leaf; `at` is the cell there."""
    if not cell_of(frame, leaves.planes[leaves.plane[i]], axis, a, b, at):
        return False
    low = leaves.corner[i, axis]
    return bool(low <= at[axis] < low + leaves.side[i])


@compiled
def _choose_columns(
    frame: Frame,
    leaves: Leaves,
    i: int,
    owner: Owners,
    cover: Bytes,
    choice: Choice,
    bits: Bytes,
) -> None:
    """Choose the columns of a leaf: the error of its points against that of leaving them out."""
    corner, side, plane = leaves.corner[i], leaves.side[i], leaves.planes[leaves.plane[i]]
    axis = dominant(plane)
    low_u, low_v = corner[(axis + 1) % 3], corner[(axis + 2) % 3]
    gains = np.zeros((side, side))
    known = np.zeros((side + 2, side + 2), np.int64)
    at, point = np.zeros(3, np.int64), np.zeros(3)
    for a in range(-1, side + 1):
        for b in range(-1, side + 1):
            if 0 <= a < side and 0 <= b < side:
                if in_leaf(frame, leaves, i, axis, low_u + a, low_v + b, at):
                    gains[a, b] = _gain(plane, axis, low_u + a, low_v + b, choice, point)
            else:
                place = (axis, low_u + a, low_v + b)
                known[a + 1, b + 1] = _state(frame, plane, place, owner, cover, at)
    choose(gains, choice.edge, known, bits)


@compiled_in_place
def _gain(plane: Floats, axis: int, a: int, b: int, choice: Choice, p: Floats) -> float:
    """Error that a column saves, from four points of it; p: (3,) room for them."""
    gain = 0.0
    for k in range(4):
        p_u, p_v = a + 0.25 + 0.5 * (k & 1), b + 0.25 + 0.5 * (k >> 1)
        p[(axis + 1) % 3], p[(axis + 2) % 3] = p_u, p_v
        p[axis] = height(plane, axis, p_u, p_v)
        gain += gain_at(choice, p)
    return gain / 4 / choice.cell**2


@compiled
def _code_columns(
    coder: Coder,
    frame: Frame,
    leaves: Leaves,
    i: int,
    owner: Owners,
    bits: Bytes,
    cover: Bytes,
) -> None:
    corner, side, plane = leaves.corner[i], leaves.side[i], leaves.planes[leaves.plane[i]]
    axis = dominant(plane)
    at, beside = np.zeros(3, np.int64), np.zeros(3, np.int64)
    size = 0
    while side >> (size + 1) > 0:
        size += 1
    for a in range(side):
        for b in range(side):
            column = (axis, corner[(axis + 1) % 3] + a, corner[(axis + 2) % 3] + b)
            if in_leaf(frame, leaves, i, axis, column[1], column[2], at):
                contexts = _contexts(frame, plane, column, size, owner, cover, beside)
                bit = code_bit(coder, bits[a, b], _MIXER, contexts)
                cover[at[0], at[1], at[2]] = _SURFACE if bit else _EMPTY


@compiled_in_place
def _contexts(
    frame: Frame,
    plane: Floats,
    column: tuple[int, int, int],
    size: int,
    owner: Owners,
    cover: Bytes,
    at: Ints,
) -> tuple[int, int, int]:
    """Contexts of a column's bit: the eight columns around it, and the leaf's size."""
    faces = diagonals = count = 0
    axis, a, b = column
    for da in range(-1, 2):
        for db in range(-1, 2):
            if da == 0 and db == 0:
                continue
            state = _state(frame, plane, (axis, a + da, b + db), owner, cover, at)
            count += state == _SURFACE
            if da == 0 or db == 0:
                faces = 3 * faces + state
            else:
                diagonals = 3 * diagonals + state
    by_size = _FACES + faces + 81 * min(size - 1, 8)
    return by_size, _AROUND + faces + 81 * diagonals, _COUNTS + 16 * count + size


@compiled_in_place
def _state(
    frame: Frame,
    plane: Floats,
    column: tuple[int, int, int],
    owner: Owners,
    cover: Bytes,
    at: Ints,
) -> int:
    """State of a column (axis, place) in the cell where the plane crosses it."""
    if not cell_of(frame, plane, column[0], column[1], column[2], at):
        return _EMPTY
    state = cover[at[0], at[1], at[2]]
    if state != _UNKNOWN:
        return int(state)
    return _UNKNOWN if owner_at(frame, owner, at[0], at[1], at[2]) > 0 else _EMPTY

"""What coder and decoder know around a voxel's children: which cells are occupied, which unknown.

A voxel's children and the ring around them are 4x4x4 cells, a bit each, ``x + 4 y + 16 z``; its own
children are the inner eight. A cell is unknown while its parent is there but not coded yet.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.sparse.voxels import CENTRE, CHILDREN, FACES, OFFSETS, Table
from puckbench.core.compiling import compiled_in_place

Ints = NDArray[np.int64]
_STEPS = (1, 4, 16)


class Cells(NamedTuple):
    """Numbers of cells, and sets of them as 64 bits.

    occupied: (27, 256) those of a neighbour's children with a code. whole: (27,) all of its.
    own: (8,) of a voxel's children. beyond: (8, 3) those at a child's faces outside its voxel.
    second: (8, 3) those two steps away to the other side. edges: (8, 3) those outside at its edges
    where two faces meet outside, across: (8, 6) where one does. faces, ring, corners, far: (8,) all
    that a child touches by faces, edges and corners, and all that it does not touch.
    """

    occupied: Ints
    whole: Ints
    own: Ints
    beyond: Ints
    second: Ints
    edges: Ints
    across: Ints
    faces: Ints
    ring: Ints
    corners: Ints
    far: Ints


class Known(NamedTuple):
    """What is known of a level.

    neighbours: (27, n). codes: (n,) children so far, a bit each. done: (n,) whether all are known.
    occupied, unknown: (n,) cells around a voxel, of the groups before its own. touched: (n,) which
    of the six faces have a neighbour; crowd: (n,) how many neighbours there are; spread: (n,) along
    which axes they are, see `_spread`.
    """

    neighbours: Table
    codes: NDArray[np.uint8]
    done: NDArray[np.bool_]
    occupied: Ints
    unknown: Ints
    touched: NDArray[np.uint8]
    crowd: NDArray[np.uint8]
    spread: NDArray[np.uint8]


def known_of(neighbours: Table) -> Known:
    """A level of which nothing is known yet."""
    count = neighbours.shape[1]
    codes, touched, crowd, spread = np.zeros((4, count), np.uint8)
    occupied, unknown = np.empty((2, count), np.int64)
    return Known(
        neighbours, codes, np.zeros(count, np.bool_), occupied, unknown, touched, crowd, spread
    )


def look_around(level: Known, rows: Ints) -> None:
    """Note what is known around some voxels, before their first symbols are coded."""
    _look_around(level, rows, CELLS)


@compiled_in_place
def _look_around(level: Known, rows: Ints, cells: Cells) -> None:
    for i in range(len(rows)):
        row = rows[i]
        occupied, unknown, crowd, touched, x, y, z = 0, 0, -1, 0, 0, 0, 0
        for offset in range(OFFSETS):
            other = level.neighbours[offset, row]
            if other >= 0:
                crowd += 1
                x, y, z = x + (offset % 3 != 1), y + (offset // 3 % 3 != 1), z + (offset // 9 != 1)
                if level.done[other]:
                    occupied |= cells.occupied[offset, level.codes[other]]
                elif offset != CENTRE:
                    unknown |= cells.whole[offset]
        for place in range(6):
            touched |= (level.neighbours[FACES[place], row] >= 0) << place
        level.occupied[row], level.unknown[row] = occupied, unknown
        level.touched[row], level.crowd[row] = touched, crowd
        level.spread[row] = 9 * _spread(x, crowd) + 3 * _spread(y, crowd) + _spread(z, crowd)


@compiled_in_place
def _spread(beside: int, crowd: int) -> int:
    """Share of the neighbours that are not in the voxel's own layer along an axis, in three steps.

    Of a full neighbourhood it is 18 / 26, of a plane across the axis 0, of one along it 6 / 8.
    """
    return (20 * beside >= 9 * crowd) + (20 * beside >= 13 * crowd)


@compiled_in_place
def count_of(cells: int) -> int:
    """How many cells are in a set."""
    pairs = cells - ((cells >> 1) & 0x5555555555555555)
    fours = (pairs & 0x3333333333333333) + ((pairs >> 2) & 0x3333333333333333)
    eights = (fours + (fours >> 4)) & 0x0F0F0F0F0F0F0F0F
    return (eights * 0x0101010101010101) >> 56


def _cells() -> Cells:
    occupied, whole = np.zeros((OFFSETS, 256), np.int64), np.zeros(OFFSETS, np.int64)
    for offset in range(OFFSETS):
        steps = [2 * (offset // 3**axis % 3 - 1) for axis in range(3)]
        for child in range(CHILDREN):
            place = [1 + steps[axis] + (child >> axis & 1) for axis in range(3)]
            if all(0 <= at < 4 for at in place):
                whole[offset] |= _bit(_cell(place))
                occupied[offset, (np.arange(256) >> child & 1) == 1] |= _bit(_cell(place))
    places = [[1 + (child >> axis & 1) for axis in range(3)] for child in range(CHILDREN)]
    own = np.array([_cell(place) for place in places])
    out = np.array([[(1 if c >> a & 1 else -1) * _STEPS[a] for a in range(3)] for c in range(8)])
    sides = [(a, b) for a in range(3) for b in range(3) if a != b]
    return Cells(
        occupied,
        whole,
        own,
        own[:, None] + out,
        own[:, None] - 2 * out,
        own[:, None] + out.sum(axis=1, keepdims=True) - out,
        np.stack([own + out[:, a] - out[:, b] for a, b in sides], axis=1),
        _at_steps(places, 1),
        _at_steps(places, 2),
        _at_steps(places, 3),
        _at_steps(places, None),
    )


def _cell(place: list[int]) -> int:
    return sum(step * at for step, at in zip(_STEPS, place, strict=True))


def _bit(cell: int) -> np.int64:
    return np.uint64(1 << cell).astype(np.int64)


def _at_steps(places: list[list[int]], steps: int | None) -> Ints:
    """For each child the cells that it touches in so many axes' steps; for none those far away."""
    found = np.zeros(CHILDREN, np.int64)
    for child, place in enumerate(places):
        for cell in product(range(4), repeat=3):
            apart = [abs(at - mine) for at, mine in zip(cell, place, strict=True)]
            if (sum(apart) if max(apart) < 2 else None) == steps:
                found[child] |= _bit(_cell(list(cell)))
    return found


CELLS = _cells()

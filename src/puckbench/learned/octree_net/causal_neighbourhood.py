"""The causal neighbourhood of a voxel's children: what encoder and decoder know before coding them.

A voxel's children and the ring around them are 4x4x4 cells, a bit each, ``x + 4 y + 16 z``; its own
children are the inner eight. A cell is unknown while its parent is occupied but not coded yet.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled_in_place
from puckbench.learned.sparse.voxels import CENTRE, CHILDREN, FACES, OFFSETS, NeighbourTable

Ints = NDArray[np.int64]
_STEPS = (1, 4, 16)


class CellMasks(NamedTuple):
    """Numbers of cells, and sets of cells as masks of 64 bits.

    Parameters
    ----------
    occupied
        (27, 256), masks of the occupied children of the neighbour at each offset, by their code.
    whole
        (27,), masks of all children of the neighbour at each offset.
    own
        (8,), cells of a voxel's children.
    beyond
        (8, 3), cells that share a face with a child, outside its voxel, along x, y and z.
    second
        (8, 3), cells two steps from a child, on the other side.
    edges
        (8, 3), cells that share an edge with a child, where both faces at it are outside the voxel.
    across
        (8, 6), the same, where one of the faces is.
    faces, ring, corners, far
        (8,), masks of all cells that share a face, an edge, a corner, or nothing with a child.
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


class LevelState(NamedTuple):
    """What is known of the children of a level's n voxels so far.

    Parameters
    ----------
    neighbours
        (27, n), table of neighbours.
    codes
        (n,), occupied children, a bit each.
    done
        (n,), whether all children are known.
    occupied, unknown
        (n,), masks of the cells around a voxel, by the groups before its own.
    face_neighbours
        (n,), which of the six faces have a neighbour, a bit each.
    neighbour_counts
        (n,), how many neighbours there are.
    orientations
        (n,), how the neighbours are distributed along the axes, see `_share_outside_layer`.
    """

    neighbours: NeighbourTable
    codes: NDArray[np.uint8]
    done: NDArray[np.bool_]
    occupied: Ints
    unknown: Ints
    face_neighbours: NDArray[np.uint8]
    neighbour_counts: NDArray[np.uint8]
    orientations: NDArray[np.uint8]


def empty_state(neighbours: NeighbourTable) -> LevelState:
    """The state of a level before any of its voxels is coded."""
    count = neighbours.shape[1]
    codes, *rest = np.zeros((4, count), np.uint8)
    occupied, unknown = np.empty((2, count), np.int64)
    return LevelState(neighbours, codes, np.zeros(count, np.bool_), occupied, unknown, *rest)


def find_neighbourhood(level: LevelState, rows: Ints) -> None:
    """Find the causal neighbourhood of some voxels, before their first symbols are coded."""
    _find_neighbourhood(level, rows, CELLS)


@compiled_in_place
def _find_neighbourhood(level: LevelState, rows: Ints, cells: CellMasks) -> None:
    for i in range(len(rows)):
        row = rows[i]
        occupied, unknown, count, faces, x, y, z = 0, 0, -1, 0, 0, 0, 0
        for offset in range(OFFSETS):
            other = level.neighbours[offset, row]
            if other >= 0:
                count += 1
                x, y, z = x + (offset % 3 != 1), y + (offset // 3 % 3 != 1), z + (offset // 9 != 1)
                if level.done[other]:
                    occupied |= cells.occupied[offset, level.codes[other]]
                elif offset != CENTRE:
                    unknown |= cells.whole[offset]
        for place in range(6):
            faces |= (level.neighbours[FACES[place], row] >= 0) << place
        level.occupied[row], level.unknown[row] = occupied, unknown
        level.face_neighbours[row], level.neighbour_counts[row] = faces, count
        level.orientations[row] = (
            9 * _share_outside_layer(x, count)
            + 3 * _share_outside_layer(y, count)
            + _share_outside_layer(z, count)
        )


@compiled_in_place
def _share_outside_layer(outside: int, count: int) -> int:
    """Share of the neighbours that are outside the voxel's layer along an axis, in three steps.

    Of a full neighbourhood it is 18 / 26, of a plane across the axis 0, of one along it 6 / 8.
    """
    return (20 * outside >= 9 * count) + (20 * outside >= 13 * count)


def _cells() -> CellMasks:
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
    return CellMasks(
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
    """Masks (8,) of the cells some steps from a child; for None of those it does not touch."""
    found = np.zeros(CHILDREN, np.int64)
    for child, place in enumerate(places):
        for cell in product(range(4), repeat=3):
            apart = [abs(at - mine) for at, mine in zip(cell, place, strict=True)]
            if (sum(apart) if max(apart) < 2 else None) == steps:
                found[child] |= _bit(_cell(list(cell)))
    return found


CELLS = _cells()

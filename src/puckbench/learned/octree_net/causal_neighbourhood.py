"""Causal neighbourhood of a voxel's children: cells known before they are coded.

A voxel's children, the inner eight of 4x4x4 cells, and the cells around them are bits of a mask:
cell (x, y, z) is bit ``x + 4 y + 16 z``. A cell is unknown while its parent is occupied but not
coded yet.
"""

from __future__ import annotations

import operator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled_in_place
from puckbench.learned.sparse.voxels import CENTRE, CHILDREN, FACES, OFFSETS, NeighbourTable

Ints = NDArray[np.int64]
_STEPS = (1, 4, 16)


class CellMasks(NamedTuple):
    """Indices of cells, and sets of cells as 64-bit masks."""

    # (27, 256), occupied children of the neighbour at each offset, by their occupancy
    occupied: Ints
    whole: Ints  # (27,), all children of the neighbour at each offset
    inner: Ints  # (8,), cells of the voxel's children
    beyond: Ints  # (8, 3), cells that share a face with a child outside the voxel, along x, y and z
    second: Ints  # (8, 3), cells two steps inwards from a child, along x, y and z
    edges: Ints  # (8, 3), cells one step outwards from a child along each of two axes
    across: Ints  # (8, 6), cells one step outwards along an axis and one inwards along another
    faces: Ints  # (8,), all cells that share a face with a child
    ring: Ints  # (8,), cells that share an edge
    corners: Ints  # (8,), cells that share a corner
    far: Ints  # (8,), cells that do not touch it


class LevelState(NamedTuple):
    neighbours: NeighbourTable  # (27, n), neighbour table
    codes: NDArray[np.uint8]  # (n,), occupancy of children, a bit each
    done: NDArray[np.bool_]  # (n,), whether all children are known
    occupied: Ints  # (n,), occupied cells around a voxel, by the groups before its own
    unknown: Ints  # (n,), unknown cells around a voxel
    face_neighbours: NDArray[np.uint8]  # (n,), which of six faces have a neighbour, a bit each
    neighbour_counts: NDArray[np.uint8]  # (n,)
    # (n,), distribution of neighbours along axes, see `_share_outside_layer`
    orientations: NDArray[np.uint8]


def empty_state(neighbours: NeighbourTable) -> LevelState:
    count = neighbours.shape[1]
    codes, *counts = np.zeros((4, count), np.uint8)
    occupied, unknown = np.empty((2, count), np.int64)
    return LevelState(neighbours, codes, np.zeros(count, np.bool_), occupied, unknown, *counts)


def find_neighbourhood(level: LevelState, rows: Ints) -> None:
    """Compute the causal neighbourhoods of voxels, before their first symbols are coded."""
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
        for face in range(6):
            faces |= (level.neighbours[FACES[face], row] >= 0) << face
        level.occupied[row], level.unknown[row] = occupied, unknown
        level.face_neighbours[row], level.neighbour_counts[row] = faces, count
        level.orientations[row] = (
            9 * _share_outside_layer(x, count)
            + 3 * _share_outside_layer(y, count)
            + _share_outside_layer(z, count)
        )


@compiled_in_place
def _share_outside_layer(outside: int, count: int) -> int:
    """Quantise to 0, 1 or 2 the fraction of neighbours outside the voxel's layer across an axis.

    It is 18 / 26 if all neighbours are occupied, 0 if only those in a plane perpendicular to the
    axis.
    """
    return (20 * outside >= 9 * count) + (20 * outside >= 13 * count)


def _cells() -> CellMasks:
    occupied, whole = np.zeros((OFFSETS, 256), np.int64), np.zeros(OFFSETS, np.int64)
    for offset in range(OFFSETS):
        steps = [2 * (offset // 3**axis % 3 - 1) for axis in range(3)]
        for child in range(CHILDREN):
            position = [1 + steps[axis] + (child >> axis & 1) for axis in range(3)]
            if all(0 <= coordinate < 4 for coordinate in position):
                whole[offset] |= _bit(_cell(position))
                occupied[offset, (np.arange(256) >> child & 1) == 1] |= _bit(_cell(position))
    positions = [[1 + (child >> axis & 1) for axis in range(3)] for child in range(CHILDREN)]
    inner = np.array([_cell(position) for position in positions])
    outward = np.array(
        [[(1 if c >> a & 1 else -1) * _STEPS[a] for a in range(3)] for c in range(8)]
    )
    sides = [(a, b) for a in range(3) for b in range(3) if a != b]
    return CellMasks(
        occupied,
        whole,
        inner,
        inner[:, None] + outward,
        inner[:, None] - 2 * outward,
        inner[:, None] + outward.sum(axis=1, keepdims=True) - outward,
        np.stack([inner + outward[:, a] - outward[:, b] for a, b in sides], axis=1),
        _cells_at(positions, 1),
        _cells_at(positions, 2),
        _cells_at(positions, 3),
        _cells_at(positions, None),
    )


def _cell(position: list[int]) -> int:
    return sum(map(operator.mul, _STEPS, position))


def _bit(cell: int) -> np.int64:
    return np.uint64(1 << cell).astype(np.int64)


def _cells_at(positions: list[list[int]], distance: int | None) -> Ints:
    """Return masks (8,) of the cells 1 to 3 steps from each child; for None, of those that do not
    touch it.
    """
    masks = np.zeros(CHILDREN, np.int64)
    for child, position in enumerate(positions):
        for cell in product(range(4), repeat=3):
            steps = [abs(a - b) for a, b in zip(cell, position, strict=True)]
            if (sum(steps) if max(steps) < 2 else None) == distance:
                masks[child] |= _bit(_cell(list(cell)))
    return masks


CELLS = _cells()

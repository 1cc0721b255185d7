"""The cells around a voxel whose occupancy is known before the voxel's children are coded.

The children of a voxel are the inner eight of 4x4x4 cells. Cell (x, y, z) is bit ``x + 4 y + 16 z``
of a mask. A cell is unknown if its parent is occupied, but the parent's children are not coded yet.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcc_networks.sparse.voxels import CENTRE, FACES, OFFSETS, NeighbourTable
from pointkit.compiling import compiled_in_place

Ints = NDArray[np.int64]
_STEPS = np.array([1, 4, 16])
_BITS = np.left_shift(1, np.arange(64))


class CellMasks(NamedTuple):
    """Tables of the cells around a voxel: their indices, and sets of them as 64-bit masks."""

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
    """What is known of the voxels of a level while their children are coded."""

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
    """Return the state of a level before any children are coded, for a neighbour table (27, n)."""
    count = neighbours.shape[1]
    codes, *counts = np.zeros((4, count), np.uint8)
    occupied, unknown = np.empty((2, count), np.int64)
    return LevelState(neighbours, codes, np.zeros(count, np.bool_), occupied, unknown, *counts)


def find_neighbourhood(level: LevelState, rows: Ints) -> None:
    """Find the occupied and unknown cells around voxels `rows` (m,), and write them to `level`."""
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
    """Return 0, 1 or 2 for a small, medium or large share of neighbours outside a voxel's layer."""
    return (20 * outside >= 9 * count) + (20 * outside >= 13 * count)


def _cells() -> CellMasks:
    children = np.arange(8)[:, None] >> np.arange(3) & 1  # positions (8, 3) in the parent
    steps = np.arange(OFFSETS)[:, None] // 3 ** np.arange(3) % 3 - 1
    positions = 1 + 2 * steps[:, None] + children
    is_inside = ((positions >= 0) & (positions < 4)).all(axis=2)
    cells = np.where(is_inside, positions @ _STEPS, 0)
    bits = np.where(is_inside, _BITS[cells], 0)  # of the children of each neighbour, (27, 8)
    codes = np.arange(256)[:, None] >> np.arange(8) & 1
    inner, outward = cells[CENTRE], np.where(children == 1, 1, -1) * _STEPS
    sides = [(a, b) for a in range(3) for b in range(3) if a != b]
    everywhere = np.arange(64)[:, None] // _STEPS % 4
    distances = np.abs(1 + children[:, None] - everywhere)
    near = np.where(distances.max(axis=2) < 2, distances.sum(axis=2), -1)
    return CellMasks(
        bits @ codes.T,
        bits.sum(axis=1),
        inner,
        inner[:, None] + outward,
        inner[:, None] - 2 * outward,
        inner[:, None] + outward.sum(axis=1, keepdims=True) - outward,
        np.stack([inner + outward[:, a] - outward[:, b] for a, b in sides], axis=1),
        *((near == distance) @ _BITS for distance in (1, 2, 3, -1)),
    )


CELLS = _cells()

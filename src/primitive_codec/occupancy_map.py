"""Occupancy maps of planes: one bit per column of cells, coded with contexts.

As in V-PCC, a map marks the part of a plane that the surface covers. Columns run along the plane's
dominant axis. One grid stores the states of all columns, so that contexts include neighbouring
leaves.
"""

from __future__ import annotations

import numpy as np

from pointkit.coding.binary_coder import exhausted
from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats
from primitive_codec.entropy import ContextCoder, code_bit, is_writing
from primitive_codec.occupancy_decision import (
    OccupancyCriterion,
    distortion_reduction,
    optimise_occupancy_map,
)
from primitive_codec.octree_arrays import (
    EMPTY,
    OCCUPIED,
    UNKNOWN,
    Bytes,
    Ints,
    OctreeGeometry,
    PlaneOctree,
    dominant_axis,
    leaf_at,
    plane_height,
)
from primitive_codec.stream import MAX_LEAF_COLUMNS
from primitive_codec.traversal import CONTEXTS as TREE_CONTEXTS
from primitive_codec.traversal import MIXERS as TREE_MIXERS

_FACES = TREE_CONTEXTS
_NEIGHBOURHOOD = _FACES + 81 * 9
_COUNTS = _NEIGHBOURHOOD + 6561
CONTEXTS = _COUNTS + 16 * 9
_MIXER = TREE_MIXERS
MIXERS = TREE_MIXERS + 1


@compiled
def code_occupancy_maps(
    coder: ContextCoder, octree: PlaneOctree, criterion: OccupancyCriterion
) -> None:
    """Encode or decode the occupancy maps of all leaves, or of fewer if the stream ends early.

    A column's state is stored in the cell where the column crosses the plane. A leaf of one cell is
    always occupied and takes no bit.
    """
    leaves = octree.leaves
    for i in range(leaves.counts[0]):
        if leaves.side[i] == 1:
            corner = leaves.corner[i]
            octree.occupancy[corner[0], corner[1], corner[2]] = OCCUPIED
    bits = np.zeros((MAX_LEAF_COLUMNS, MAX_LEAF_COLUMNS), np.uint8)
    for i in range(leaves.counts[0]):
        side = leaves.side[i]
        if exhausted(coder.bits):
            return
        if side == 1:
            continue
        if is_writing(coder):
            _decide_columns(octree, i, criterion, bits[:side, :side])
        _code_columns(coder, octree, i, bits[:side, :side])


@compiled_in_place
def find_plane_cell(
    geometry: OctreeGeometry, plane: Floats, axis: int, a: int, b: int, cell: Ints
) -> bool:
    """Write the cell (3,) where a plane crosses column (a, b); return False outside the grid."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    if a < 0 or b < 0 or a >= geometry.shape[u] or b >= geometry.shape[v]:
        return False
    height = plane_height(plane, axis, a + 0.5, b + 0.5)
    if not 0 <= height < geometry.shape[axis]:
        return False
    cell[axis], cell[u], cell[v] = int(height), a, b
    return True


@compiled_in_place
def find_leaf_cell(octree: PlaneOctree, i: int, axis: int, a: int, b: int, cell: Ints) -> bool:
    """Write the cell where a leaf's plane crosses a column; return False outside the leaf."""
    leaves = octree.leaves
    if not find_plane_cell(octree.geometry, leaves.planes[leaves.plane_index[i]], axis, a, b, cell):
        return False
    low = leaves.corner[i, axis]
    return bool(low <= cell[axis] < low + leaves.side[i])


@compiled
def _decide_columns(
    octree: PlaneOctree, i: int, criterion: OccupancyCriterion, bits: Bytes
) -> None:
    leaves = octree.leaves
    corner, side, plane = leaves.corner[i], leaves.side[i], leaves.planes[leaves.plane_index[i]]
    axis = dominant_axis(plane)
    low_u, low_v = corner[(axis + 1) % 3], corner[(axis + 2) % 3]
    gains = np.zeros((side, side))
    surrounding = np.zeros((side + 2, side + 2), np.int64)
    cell, point = np.zeros(3, np.int64), np.zeros(3)
    for a in range(-1, side + 1):
        for b in range(-1, side + 1):
            if 0 <= a < side and 0 <= b < side:
                if find_leaf_cell(octree, i, axis, low_u + a, low_v + b, cell):
                    gains[a, b] = _column_gain(plane, axis, low_u + a, low_v + b, criterion, point)
            else:
                column = (axis, low_u + a, low_v + b)
                surrounding[a + 1, b + 1] = _column_state(octree, plane, column, cell)
    optimise_occupancy_map(gains, criterion.edge_cost, surrounding, bits)


@compiled_in_place
def _column_gain(
    plane: Floats, axis: int, a: int, b: int, criterion: OccupancyCriterion, p: Floats
) -> float:
    """Return a column's reduction of the distortion, a mean of four points; `p` (3,) is scratch."""
    gain = 0.0
    for k in range(4):
        p_u, p_v = a + 0.25 + 0.5 * (k & 1), b + 0.25 + 0.5 * (k >> 1)
        p[(axis + 1) % 3], p[(axis + 2) % 3] = p_u, p_v
        p[axis] = plane_height(plane, axis, p_u, p_v)
        gain += distortion_reduction(criterion, p)
    return gain / 4 / criterion.spacing**2


@compiled
def _code_columns(coder: ContextCoder, octree: PlaneOctree, i: int, bits: Bytes) -> None:
    leaves = octree.leaves
    corner, side, plane = leaves.corner[i], leaves.side[i], leaves.planes[leaves.plane_index[i]]
    axis = dominant_axis(plane)
    cell, neighbour_cell = np.zeros(3, np.int64), np.zeros(3, np.int64)
    side_log2 = 0
    while side >> (side_log2 + 1) > 0:
        side_log2 += 1
    for a in range(side):
        for b in range(side):
            column = (axis, corner[(axis + 1) % 3] + a, corner[(axis + 2) % 3] + b)
            if find_leaf_cell(octree, i, axis, column[1], column[2], cell):
                contexts = _contexts(octree, plane, column, side_log2, neighbour_cell)
                bit = code_bit(coder, bits[a, b], _MIXER, contexts)
                octree.occupancy[cell[0], cell[1], cell[2]] = OCCUPIED if bit else EMPTY


@compiled_in_place
def _contexts(
    octree: PlaneOctree, plane: Floats, column: tuple[int, int, int], side_log2: int, cell: Ints
) -> tuple[int, int, int]:
    faces = diagonals = count = 0
    axis, a, b = column
    for da in range(-1, 2):
        for db in range(-1, 2):
            if da == 0 and db == 0:
                continue
            state = _column_state(octree, plane, (axis, a + da, b + db), cell)
            count += state == OCCUPIED
            if da == 0 or db == 0:
                faces = 3 * faces + state
            else:
                diagonals = 3 * diagonals + state
    size_context = _FACES + faces + 81 * min(side_log2 - 1, 8)
    return size_context, _NEIGHBOURHOOD + faces + 81 * diagonals, _COUNTS + 16 * count + side_log2


@compiled_in_place
def _column_state(
    octree: PlaneOctree, plane: Floats, column: tuple[int, int, int], cell: Ints
) -> int:
    if not find_plane_cell(octree.geometry, plane, column[0], column[1], column[2], cell):
        return EMPTY
    state = octree.occupancy[cell[0], cell[1], cell[2]]
    if state != UNKNOWN:
        return int(state)
    return UNKNOWN if leaf_at(octree, cell[0], cell[1], cell[2]) > 0 else EMPTY

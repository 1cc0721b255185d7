"""Occupancy maps of the leaves' planes: one bit for each column of cells, coded in context.

As in V-PCC's patches, an occupancy map says where on a plane there is surface. A column is one cell
wide and runs along the plane's dominant axis. The columns of all leaves share a grid of cells, so
that the contexts of a map continue where the neighbouring leaf's map ended.
"""

from __future__ import annotations

import numpy as np

from puckbench.coding.binary_coder import exhausted
from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats
from puckbench.primitives.entropy import Coder, code_bit
from puckbench.primitives.occupancy_decision import (
    RdCriterion,
    distortion_saved,
    optimise_map,
)
from puckbench.primitives.octree_arrays import (
    EMPTY,
    OCCUPIED,
    UNKNOWN,
    Bytes,
    Ints,
    LeafMap,
    Leaves,
    OctreeGeometry,
    dominant_axis,
    leaf_at,
    plane_height,
)
from puckbench.primitives.stream import MAX_LEAF_COLUMNS
from puckbench.primitives.traversal import CONTEXTS as TREE_CONTEXTS
from puckbench.primitives.traversal import MIXERS as TREE_MIXERS

_FACES = TREE_CONTEXTS
_NEIGHBOURHOOD = _FACES + 81 * 9
_COUNTS = _NEIGHBOURHOOD + 6561
CONTEXTS = _COUNTS + 16 * 9
_MIXER = TREE_MIXERS
MIXERS = TREE_MIXERS + 1


@compiled
def code_occupancy_maps(
    coder: Coder,
    geometry: OctreeGeometry,
    leaves: Leaves,
    leaf_map: LeafMap,
    criterion: RdCriterion,
    occupancy: Bytes,
) -> None:
    """Code the occupancy maps of all leaves, or of those until a stream ends.

    Parameters
    ----------
    coder
        Writes or reads.
    geometry, leaves, leaf_map
        The decoded octree of planes.
    criterion
        What the encoder decides by; not used in decoding.
    occupancy
        Grid of cells (x, y, z), written: the state of the column that ends in each cell. A leaf of
        one cell is occupied without a bit.
    """
    for i in range(leaves.counts[0]):
        if leaves.side[i] == 1:
            cell = leaves.corner[i]
            occupancy[cell[0], cell[1], cell[2]] = OCCUPIED
    bits = np.zeros((MAX_LEAF_COLUMNS, MAX_LEAF_COLUMNS), np.uint8)
    for i in range(leaves.counts[0]):
        side = leaves.side[i]
        if exhausted(coder.bits):
            return
        if side == 1:
            continue
        if coder.bits.registers[4] == 1:
            _decide_columns(geometry, leaves, i, leaf_map, occupancy, criterion, bits[:side, :side])
        _code_columns(coder, geometry, leaves, i, leaf_map, bits[:side, :side], occupancy)


@compiled_in_place
def cell_on_plane(
    geometry: OctreeGeometry, plane: Floats, axis: int, a: int, b: int, at: Ints
) -> bool:
    """Write to `at` (3,) the cell where a plane crosses a column; false outside the grid."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    if a < 0 or b < 0 or a >= geometry.shape[u] or b >= geometry.shape[v]:
        return False
    place = plane_height(plane, axis, a + 0.5, b + 0.5)
    if not 0 <= place < geometry.shape[axis]:
        return False
    at[axis], at[u], at[v] = int(place), a, b
    return True


@compiled_in_place
def column_in_leaf(
    geometry: OctreeGeometry, leaves: Leaves, i: int, axis: int, a: int, b: int, at: Ints
) -> bool:
    """Whether the plane of leaf i crosses column (a, b) within the leaf, in the cell `at`."""
    if not cell_on_plane(geometry, leaves.planes[leaves.plane_index[i]], axis, a, b, at):
        return False
    low = leaves.corner[i, axis]
    return bool(low <= at[axis] < low + leaves.side[i])


@compiled
def _decide_columns(
    geometry: OctreeGeometry,
    leaves: Leaves,
    i: int,
    leaf_map: LeafMap,
    occupancy: Bytes,
    criterion: RdCriterion,
    bits: Bytes,
) -> None:
    """Choose the occupancy map of a leaf by rate and distortion."""
    corner, side, plane = leaves.corner[i], leaves.side[i], leaves.planes[leaves.plane_index[i]]
    axis = dominant_axis(plane)
    low_u, low_v = corner[(axis + 1) % 3], corner[(axis + 2) % 3]
    gains = np.zeros((side, side))
    known = np.zeros((side + 2, side + 2), np.int64)
    at, point = np.zeros(3, np.int64), np.zeros(3)
    for a in range(-1, side + 1):
        for b in range(-1, side + 1):
            if 0 <= a < side and 0 <= b < side:
                if column_in_leaf(geometry, leaves, i, axis, low_u + a, low_v + b, at):
                    gains[a, b] = _column_gain(plane, axis, low_u + a, low_v + b, criterion, point)
            else:
                place = (axis, low_u + a, low_v + b)
                known[a + 1, b + 1] = _column_state(geometry, plane, place, leaf_map, occupancy, at)
    optimise_map(gains, criterion.edge_cost, known, bits)


@compiled_in_place
def _column_gain(
    plane: Floats, axis: int, a: int, b: int, criterion: RdCriterion, p: Floats
) -> float:
    """Distortion that a column saves, estimated at four of its points; p: (3,) scratch."""
    gain = 0.0
    for k in range(4):
        p_u, p_v = a + 0.25 + 0.5 * (k & 1), b + 0.25 + 0.5 * (k >> 1)
        p[(axis + 1) % 3], p[(axis + 2) % 3] = p_u, p_v
        p[axis] = plane_height(plane, axis, p_u, p_v)
        gain += distortion_saved(criterion, p)
    return gain / 4 / criterion.spacing**2


@compiled
def _code_columns(
    coder: Coder,
    geometry: OctreeGeometry,
    leaves: Leaves,
    i: int,
    leaf_map: LeafMap,
    bits: Bytes,
    occupancy: Bytes,
) -> None:
    """Code a leaf's occupancy map and enter its columns into the grid of cells."""
    corner, side, plane = leaves.corner[i], leaves.side[i], leaves.planes[leaves.plane_index[i]]
    axis = dominant_axis(plane)
    at, beside = np.zeros(3, np.int64), np.zeros(3, np.int64)
    size = 0
    while side >> (size + 1) > 0:
        size += 1
    for a in range(side):
        for b in range(side):
            column = (axis, corner[(axis + 1) % 3] + a, corner[(axis + 2) % 3] + b)
            if column_in_leaf(geometry, leaves, i, axis, column[1], column[2], at):
                contexts = _contexts(geometry, plane, column, size, leaf_map, occupancy, beside)
                bit = code_bit(coder, bits[a, b], _MIXER, contexts)
                occupancy[at[0], at[1], at[2]] = OCCUPIED if bit else EMPTY


@compiled_in_place
def _contexts(
    geometry: OctreeGeometry,
    plane: Floats,
    column: tuple[int, int, int],
    size: int,
    leaf_map: LeafMap,
    occupancy: Bytes,
    at: Ints,
) -> tuple[int, int, int]:
    """Contexts of a column's bit: the eight columns around it, and the leaf's size."""
    faces = diagonals = count = 0
    axis, a, b = column
    for da in range(-1, 2):
        for db in range(-1, 2):
            if da == 0 and db == 0:
                continue
            state = _column_state(geometry, plane, (axis, a + da, b + db), leaf_map, occupancy, at)
            count += state == OCCUPIED
            if da == 0 or db == 0:
                faces = 3 * faces + state
            else:
                diagonals = 3 * diagonals + state
    by_size = _FACES + faces + 81 * min(size - 1, 8)
    return by_size, _NEIGHBOURHOOD + faces + 81 * diagonals, _COUNTS + 16 * count + size


@compiled_in_place
def _column_state(
    geometry: OctreeGeometry,
    plane: Floats,
    column: tuple[int, int, int],
    leaf_map: LeafMap,
    occupancy: Bytes,
    at: Ints,
) -> int:
    """State of a column in the cell where the plane crosses it."""
    if not cell_on_plane(geometry, plane, column[0], column[1], column[2], at):
        return EMPTY
    state = occupancy[at[0], at[1], at[2]]
    if state != UNKNOWN:
        return int(state)
    return UNKNOWN if leaf_at(geometry, leaf_map, at[0], at[1], at[2]) > 0 else EMPTY

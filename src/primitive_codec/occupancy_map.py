"""Occupancy maps of planes, with one bit for each column of cells.

As in V-PCC, a map marks the part of a plane that the surface covers. The encoder chooses the bits,
which are coded with contexts. Columns run along the dominant axis of the plane. The states of all
columns are stored in one grid, so that contexts include neighbouring leaves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import exhausted
from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats
from primitive_codec.entropy import ContextCoder, code_bit, is_writing
from primitive_codec.octree_arrays import (
    EMPTY,
    OCCUPIED,
    UNKNOWN,
    Bytes,
    IndexGrid,
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
_MAX_ITERATIONS = 4


class OccupancyCriterion(NamedTuple):
    """Samples and costs by which the encoder chooses occupied columns, in units of cells."""

    xyz: Floats  # (n, 3) samples
    normals: Floats  # (n, 3) unit normals
    point_weights: Floats  # (n,) half the fraction of the cloud's points
    sample_at: IndexGrid  # grid of sampling cells
    spacing: float  # side of a sampling cell
    tangential_weight: float  # of the squared distance in excess of a sampling cell
    max_error: float  # bound of the squared error
    omission_error: float  # squared error of a sample that no column represents
    area_weight: float  # of a sampling cell of decoded points
    edge_cost: float  # of two adjacent columns of which one is occupied


NO_CRITERION = OccupancyCriterion(
    np.zeros((1, 3)),
    np.zeros((1, 3)),
    np.zeros(1),
    np.zeros((1, 1, 1), np.int32),
    *(1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
)
"""Criterion that a decoder passes, which needs none."""


@compiled
def code_occupancy_maps(
    coder: ContextCoder, octree: PlaneOctree, criterion: OccupancyCriterion
) -> None:
    """Encode or decode the occupancy maps of all leaves.

    The state of a column is stored in the cell where the column crosses the plane. A leaf of one
    cell is always occupied, and takes no bit. A decoder stops if the stream ends early.

    Parameters
    ----------
    coder
        Arithmetic coder; its direction decides between encoding and decoding.
    octree
        The octree with all planes, to whose `occupancy` the states are written.
    criterion
        The encoder's costs; a decoder passes `NO_CRITERION`.
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
    """Find the cell where a plane crosses column (a, b), and write it to `cell` (3,).

    Return False if this cell is outside the grid.
    """
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
    """Find the cell where the plane of leaf `i` crosses column (a, b), and write it to `cell` (3,).

    Return False if this cell is outside the leaf.
    """
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
    """Return by how much an occupied column reduces the distortion, as the mean of four points."""
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


@compiled_in_place
def distortion_reduction(criterion: OccupancyCriterion, point: Floats) -> float:
    """Return by how much decoded points around `point` (3,) reduce the distortion.

    The points fill a sampling cell.
    """
    row, squared = _nearest_sample(criterion, point)
    if row < 0:
        return -criterion.area_weight * criterion.max_error
    normal_distance = 0.0
    for k in range(3):
        normal_distance += (point[k] - criterion.xyz[row, k]) * criterion.normals[row, k]
    excess = max(np.sqrt(squared) - criterion.spacing, 0.0)
    error = normal_distance * normal_distance + criterion.tangential_weight * excess * excess
    error = min(error, criterion.max_error)
    saved = criterion.omission_error * criterion.point_weights[row] if excess == 0.0 else 0.0
    return float(saved - criterion.area_weight * error)


@compiled_in_place
def _nearest_sample(criterion: OccupancyCriterion, point: Floats) -> tuple[int, float]:
    exact_radius = np.inf  # samples outside the 27 cells around the point are farther than this
    for k in range(3):
        from_lower = point[k] - (int(point[k] / criterion.spacing) - 1) * criterion.spacing
        exact_radius = min(exact_radius, from_lower, 3 * criterion.spacing - from_lower)
    row, squared = _nearest_within(criterion, point, 1)
    if squared <= exact_radius * exact_radius:
        return row, squared
    return _nearest_within(criterion, point, 2)


@compiled_in_place
def _nearest_within(
    criterion: OccupancyCriterion, point: Floats, cell_radius: int
) -> tuple[int, float]:
    x, y, z = point
    spacing, grid = criterion.spacing, criterion.sample_at
    a, b, c = int(x / spacing), int(y / spacing), int(z / spacing)
    least, nearest = np.inf, -1
    for i in range(max(a - cell_radius, 0), min(a + cell_radius + 1, grid.shape[0])):
        for j in range(max(b - cell_radius, 0), min(b + cell_radius + 1, grid.shape[1])):
            for k in range(max(c - cell_radius, 0), min(c + cell_radius + 1, grid.shape[2])):
                row = grid[i, j, k] - 1
                if row >= 0:
                    p = criterion.xyz[row]
                    squared = (p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2
                    if squared < least:
                        least, nearest = squared, row
    return nearest, least


@compiled
def optimise_occupancy_map(gains: Floats, edge_cost: float, surrounding: Ints, bits: Bytes) -> None:
    """Choose occupied columns of a map, so that their total gain minus the cost of edges is large.

    An edge lies between an occupied and an empty column. The method is iterated conditional modes
    (Besag, "On the statistical analysis of dirty pictures", 1986).

    Parameters
    ----------
    gains
        By how much each column (n, n) reduces the distortion if it is occupied.
    edge_cost
        Cost of an edge.
    surrounding
        States (n + 2, n + 2) of the columns around the map.
    bits
        Array (n, n) that receives 1 for occupied and 0 for empty columns.
    """
    side = len(gains)
    for a in range(side):
        for b in range(side):
            bits[a, b] = 1 if gains[a, b] > 0 else 0
    for _ in range(_MAX_ITERATIONS):
        changed = False
        for a in range(side):
            for b in range(side):
                balance = _neighbour_balance(bits, surrounding, a, b)
                bit = 1 if gains[a, b] + edge_cost * balance > 0 else 0
                changed |= bit != bits[a, b]
                bits[a, b] = bit
        if not changed:
            break


@compiled_in_place
def _neighbour_balance(bits: Bytes, surrounding: Ints, a: int, b: int) -> int:
    side, balance = len(bits), 0
    for k in range(4):
        x = a + (k == 0) - (k == 1)
        y = b + (k == 2) - (k == 3)
        if 0 <= x < side and 0 <= y < side:
            balance += 2 * int(bits[x, y]) - 1
        else:
            balance += (surrounding[x + 1, y + 1] == OCCUPIED) - (
                surrounding[x + 1, y + 1] == EMPTY
            )
    return balance

"""Rate-distortion optimisation of occupancy maps: the encoder's choice of occupied columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats
from primitive_codec.octree_arrays import EMPTY, OCCUPIED, Bytes, IndexGrid, Ints

_MAX_ITERATIONS = 4


class OccupancyCriterion(NamedTuple):
    """Smoothed samples, with which decoded points are compared, and costs. Lengths are in cells."""

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
"""Placeholder for the decoder."""


@compiled_in_place
def distortion_reduction(criterion: OccupancyCriterion, point: Floats) -> float:
    """Return the distortion that a sampling cell of decoded points at `point` (3,) saves."""
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
    """Write to `bits` the map (n, n) of largest total gain minus edge cost.

    The method is iterated conditional modes (Besag, "On the statistical analysis of dirty
    pictures", 1986). `gains` (n, n) are the reductions of the distortion by occupied columns. An
    edge is between an occupied and an empty column. `surrounding` (n + 2, n + 2) holds the states
    of columns around the map.
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

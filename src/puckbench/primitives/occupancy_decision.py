"""Rate-distortion optimised occupancy maps: which columns of a leaf's plane the encoder keeps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats
from puckbench.primitives.octree_arrays import EMPTY, OCCUPIED, Bytes, Ints, LeafMap

_SWEEPS = 4


class RdCriterion(NamedTuple):
    """The smoothed samples that decoded points are compared with, and the weights of errors.

    xyz, normals: (n, 3) samples, lengths in cells. weights: (n,) shares of the cloud's points.
    sample_at: grid of sampling cells, row of the sample + 1, 0 for none. spacing: side of a
    sampling cell. tangential_weight: weight of the squared distance to the nearest sample beyond a
    sampling cell. max_error: bound of the squared error. omission_error: squared error of a sample
    that no column represents. area_weight: weight of a sampling cell of decoded points. edge_cost:
    cost of two unlike columns side by side.
    """

    xyz: Floats
    normals: Floats
    weights: Floats
    sample_at: LeafMap
    spacing: float
    tangential_weight: float
    max_error: float
    omission_error: float
    area_weight: float
    edge_cost: float


NO_CRITERION = RdCriterion(
    np.zeros((1, 3)),
    np.zeros((1, 3)),
    np.zeros(1),
    np.zeros((1, 1, 1), np.int32),
    *(1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
)
"""For the decoder, which decides nothing."""


@compiled_in_place
def distortion_saved(criterion: RdCriterion, point: Floats) -> float:
    """Distortion that decoding a sampling cell of points at `point` (3,) saves; it may be < 0."""
    row, squared = _nearest_sample(criterion, point)
    if row < 0:
        return -criterion.area_weight * criterion.max_error
    normal_distance = 0.0
    for k in range(3):
        normal_distance += (point[k] - criterion.xyz[row, k]) * criterion.normals[row, k]
    beyond = max(np.sqrt(squared) - criterion.spacing, 0.0)
    error = normal_distance * normal_distance + criterion.tangential_weight * beyond * beyond
    error = min(error, criterion.max_error)
    saved = criterion.omission_error * criterion.weights[row] if beyond == 0.0 else 0.0
    return float(saved - criterion.area_weight * error)


@compiled_in_place
def _nearest_sample(criterion: RdCriterion, point: Floats) -> tuple[int, float]:
    """Row of the nearest sample within two sampling cells (-1: none) and its squared distance."""
    certain = np.inf  # no sample outside the cells around the point's own is nearer
    for k in range(3):
        past = point[k] - (int(point[k] / criterion.spacing) - 1) * criterion.spacing
        certain = min(certain, past, 3 * criterion.spacing - past)
    row, squared = _nearest_within(criterion, point, 1)
    if squared <= certain * certain:
        return row, squared
    return _nearest_within(criterion, point, 2)


@compiled_in_place
def _nearest_within(criterion: RdCriterion, point: Floats, reach: int) -> tuple[int, float]:
    x, y, z = point
    spacing, grid = criterion.spacing, criterion.sample_at
    a, b, c = int(x / spacing), int(y / spacing), int(z / spacing)
    least, nearest = np.inf, -1
    for i in range(max(a - reach, 0), min(a + reach + 1, grid.shape[0])):
        for j in range(max(b - reach, 0), min(b + reach + 1, grid.shape[1])):
            for k in range(max(c - reach, 0), min(c + reach + 1, grid.shape[2])):
                row = grid[i, j, k] - 1
                if row >= 0:
                    p = criterion.xyz[row]
                    squared = (p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2
                    if squared < least:
                        least, nearest = squared, row
    return nearest, least


@compiled
def optimise_map(gains: Floats, edge_cost: float, known: Ints, bits: Bytes) -> None:
    """Choose the occupancy map that saves most, less `edge_cost` for each unlike pair of columns.

    Parameters
    ----------
    gains
        (n, n) distortion that each column saves if it is occupied.
    edge_cost
        Cost of an edge of the map between two columns.
    known
        (n + 2, n + 2) states of the columns around: EMPTY, OCCUPIED or UNKNOWN.
    bits
        (n, n) the map, which is written.

    References
    ----------
    Iterated conditional modes: Besag, "On the statistical analysis of dirty pictures", 1986.
    """
    side = len(gains)
    for a in range(side):
        for b in range(side):
            bits[a, b] = 1 if gains[a, b] > 0 else 0
    for _ in range(_SWEEPS):
        changed = False
        for a in range(side):
            for b in range(side):
                balance = _neighbour_balance(bits, known, a, b)
                bit = 1 if gains[a, b] + edge_cost * balance > 0 else 0
                changed |= bit != bits[a, b]
                bits[a, b] = bit
        if not changed:
            break


@compiled_in_place
def _neighbour_balance(bits: Bytes, known: Ints, a: int, b: int) -> int:
    """Occupied less empty columns among the four beside one."""
    side, balance = len(bits), 0
    for k in range(4):
        x = a + (k == 0) - (k == 1)
        y = b + (k == 2) - (k == 3)
        if 0 <= x < side and 0 <= y < side:
            balance += 2 * int(bits[x, y]) - 1
        else:
            balance += (known[x + 1, y + 1] == OCCUPIED) - (known[x + 1, y + 1] == EMPTY)
    return balance

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.geometry.spatial_order import bounding_corners
from primitive_codec.octree_arrays import Ints

_BITS = 21
"""Bits per coordinate in a key."""


class CellGroups(NamedTuple):
    cells: Ints  # (m, 3) occupied cells, sorted by x, then y, then z
    counts: Floats  # (m,) numbers of points
    means: Floats  # (m, 3) means of the points, in cells relative to the origin
    cell_of: Ints  # (n,) index of each point's cell

    def sorted_rows(self) -> tuple[Ints, Ints]:
        """Return the point indices (n,) sorted by cell, and each cell's start (m,) among them."""
        counts = self.counts.astype(np.int64)
        return np.argsort(self.cell_of, kind="stable"), np.cumsum(counts) - counts


def group_by_cell(
    points: Floats, side: float, origin: Floats | None = None, *, centred: bool = False
) -> CellGroups:
    """Group points (n, 3), n > 0, by cells of a grid.

    The points must span fewer than 2^21 cells per axis. `origin` (3,), by default zeros, is the
    centre (if `centred`) or the lowest corner of cell (0, 0, 0).
    """
    positions = (points - (0.0 if origin is None else origin)) / side
    cells = (np.rint(positions) if centred else np.floor(positions)).astype(np.int64)
    first = cells.min(axis=0)
    keys, cell_of, counts = np.unique(
        _cell_keys(cells - first), return_inverse=True, return_counts=True
    )
    sums = [np.bincount(cell_of, coordinates) for coordinates in positions.T]
    mask = (1 << _BITS) - 1
    cells = np.stack([keys >> 2 * _BITS, keys >> _BITS & mask, keys & mask], axis=1) + first
    return CellGroups(
        cells, counts.astype(float), np.stack(sums, axis=1) / counts[:, None], cell_of
    )


def centre_distances(points: Floats, origin: Floats, side: float, cells: Ints) -> Floats:
    """Return points' Chebyshev distances (n,) from the centres of their cells, in cell sides.

    The distance is infinite outside the occupied `cells` (m, 3). `origin` is the centre of cell
    (0, 0, 0).
    """
    low, high = bounding_corners(cells)
    positions = (points - origin) / side
    rows = np.flatnonzero(((positions > low - 0.5) & (positions < high + 0.5)).all(axis=1))
    positions = positions[rows]
    centres = np.rint(positions)
    keys = _cell_keys(centres.astype(np.int64) - low)
    is_occupied = np.isin(keys, _cell_keys(cells - low))
    distances = np.full(len(points), np.inf)
    distances[rows[is_occupied]] = np.abs(positions - centres).max(axis=1)[is_occupied]
    return distances


def _cell_keys(cells: Ints) -> Ints:
    """Pack cells (n, 3) in [0, 2^21) into integers (n,) that sort by x, then y, then z."""
    return (cells[:, 0] << 2 * _BITS) | (cells[:, 1] << _BITS) | cells[:, 2]

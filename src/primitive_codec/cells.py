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
    """Group points by the cells of a grid.

    Parameters
    ----------
    points
        Coordinates (n, 3), n > 0, that span fewer than 2^21 cells per axis.
    side
        Side of a cell.
    origin
        Lowest corner of the cell (0, 0, 0), by default zeros.
    centred
        Whether `origin` is the centre of that cell instead.

    Returns
    -------
    CellGroups
        The occupied cells, with the number and the mean of their points.
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
    """Return how far points are from the centres of their cells, along the farthest axis, in cell
    sides.

    Parameters
    ----------
    points
        Coordinates (n, 3).
    origin, side
        Centre of the cell (0, 0, 0), and side of a cell.
    cells
        Occupied cells (m, 3).

    Returns
    -------
    ndarray
        Distances (n,), infinite for points outside the occupied cells.
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

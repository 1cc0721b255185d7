from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.geometry.spatial_order import bounding_corners
from primitive_codec.octree_arrays import Ints

_BITS = 21
"""Bits per coordinate in a key."""


class CellGroups(NamedTuple):
    """Points grouped by the cells of a grid."""

    cells: Ints  # (m, 3) occupied cells, sorted by x, then y, then z
    counts: Floats  # (m,) numbers of points
    means: Floats  # (m, 3) means of the points, in cells relative to the origin
    cell_of: Ints  # (n,) index of each point's cell

    def sorted_rows(self) -> tuple[Ints, Ints]:
        """Sort the points by cell.

        Returns
        -------
        rows
            Indices (n,) of the points, so that points of one cell follow each other.
        starts
            Position (m,) in `rows` at which each cell begins.
        """
        counts = self.counts.astype(np.int64)
        return np.argsort(self.cell_of, kind="stable"), np.cumsum(counts) - counts


def group_by_cell(
    points: Floats, side: float, origin: Floats | None = None, *, centred: bool = False
) -> CellGroups:
    """Group points by the cells of a grid that contain them.

    Parameters
    ----------
    points
        Coordinates (n, 3), n > 0, that span fewer than 2^21 cells per axis.
    side
        Side of a cell, in the unit of the points.
    origin
        Position (3,) of the cell (0, 0, 0), by default zeros.
    centred
        Whether `origin` is the centre of this cell; by default, it is the lowest corner.

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
    """Return the distance of each point from the centre of the cell that contains it.

    The distance is the largest of the three coordinate differences, divided by the side of a cell.

    Parameters
    ----------
    points
        Coordinates (n, 3).
    origin, side
        Centre (3,) of the cell (0, 0, 0), and side of a cell.
    cells
        Occupied cells (m, 3), as integer coordinates.

    Returns
    -------
    ndarray
        Distances (n,), from 0 to 1/2; infinite for points that lie in no occupied cell.
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
    return (cells[:, 0] << 2 * _BITS) | (cells[:, 1] << _BITS) | cells[:, 2]

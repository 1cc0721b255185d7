from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats
from primitive_codec.manhattan_frame import rotate
from primitive_codec.octree_arrays import SPACING_UNIT, Bytes, Ints
from primitive_codec.revolution import (
    MAX_COLUMNS,
    RevolutionSurface,
    UnrolledMap,
    is_representable,
    pack_parameters,
    reconstruct_columns,
    unpack_parameters,
)
from primitive_codec.shape_detection import bounded_inliers, clip_to_inliers

Mask = NDArray[np.bool_]


class RevolutionCosts(NamedTuple):
    """Costs and limits by which `fit_revolutions` chooses columns. Lengths are in cells."""

    omission_error: float  # of a sample that no column represents
    tangential_weight: float  # of the squared distance in excess of a sampling cell
    max_error: float  # bound of the error
    tolerance: float  # largest distance of an inlier
    spacing: float  # side of a sampling cell
    edge_cost: float  # of two adjacent columns of which one is occupied


def to_grid(
    surface: RevolutionSurface,
    rotation: Floats,
    corner: Floats,
    cell_size: float,
    grid_offset: tuple[float, float, float],
) -> RevolutionSurface:
    """Transform a surface of revolution from the units of a cloud to the cells of a grid.

    Parameters
    ----------
    surface
        Surface in units of 1/1023 of the cloud's longest side.
    rotation
        Matrix (3, 3) from the axes of the cloud to those of the grid.
    corner
        Point (3,) in units, along the axes of the grid.
    cell_size
        Side of a cell, in units.
    grid_offset
        Position of `corner` in the grid, in cells.
    """
    origin, axis = rotate(np.stack([surface.origin, surface.axis]), rotation)
    origin = (origin - corner) / cell_size + grid_offset
    return surface._replace(origin=origin, axis=axis, radius=surface.radius / cell_size)


def fit_revolutions(
    surfaces: list[RevolutionSurface],
    xyz: Floats,
    normals: Floats,
    weights: Floats,
    costs: RevolutionCosts,
) -> tuple[list[UnrolledMap], Mask]:
    """Assign samples to surfaces of revolution, and choose the occupied columns of these surfaces.

    Parameters
    ----------
    surfaces
        Surfaces in cells, without ends. A sample that fits several surfaces is assigned to the
        first.
    xyz, normals
        Samples and their unit normals (n, 3), in cells.
    weights
        Weights (n,) of the samples, 1 on average.
    costs
        Costs of errors, of omitted samples and of edges of maps.

    Returns
    -------
    maps
        The surfaces on which samples lie, with their ends and occupancy maps.
    unexplained
        Mask (n,) of the samples that lie on no occupied column.
    """
    unexplained = np.ones(len(xyz), bool)
    maps: list[UnrolledMap] = []
    for detected in surfaces:
        clipped = clip_to_inliers(detected, xyz, normals, unexplained, costs.tolerance)
        if clipped.row_count == 0 or not is_representable(clipped):
            continue
        (surface,) = unpack_parameters(pack_parameters(clipped))
        rows = np.flatnonzero(unexplained & bounded_inliers(surface, xyz, normals, costs.tolerance))
        if not len(rows):
            continue
        columns = sum(len(unrolled.bits) for unrolled in maps) + surface.column_count()
        if columns > MAX_COLUMNS:
            continue
        unrolled = _decide_columns(surface, xyz[rows], normals[rows], weights[rows], costs)
        explained = rows[_lies_on_map(unrolled, xyz[rows])]
        if len(explained):
            maps.append(unrolled)
            unexplained[explained] = False
    return maps, unexplained


def _decide_columns(
    surface: RevolutionSurface,
    xyz: Floats,
    normals: Floats,
    weights: Floats,
    costs: RevolutionCosts,
) -> UnrolledMap:
    from scipy.spatial import cKDTree

    every_column = UnrolledMap(surface, np.ones(surface.column_count(), np.uint8))
    centres, _ = reconstruct_columns(every_column, SPACING_UNIT)
    distance, nearest = cKDTree(xyz).query(centres)
    normal_distance = ((centres - xyz[nearest]) * normals[nearest]).sum(axis=1)
    excess = np.maximum(distance - costs.spacing, 0)
    error = np.minimum(normal_distance**2 + costs.tangential_weight * excess**2, costs.max_error)
    saved = np.where(excess == 0, costs.omission_error * weights[nearest], 0.0)
    bits: Bytes = (saved > error).astype(np.uint8)
    _optimise_unrolled_map(saved - error, surface.columns_per_row(), costs.edge_cost, bits)
    return UnrolledMap(surface, bits)


@compiled
def _optimise_unrolled_map(gains: Floats, columns: Ints, edge_cost: float, bits: Bytes) -> None:
    starts = np.zeros(len(columns) + 1, np.int64)
    for row in range(len(columns)):
        starts[row + 1] = starts[row] + columns[row]
    for _ in range(4):  # iterated conditional modes (Besag 1986)
        for row in range(len(columns)):
            start, count = starts[row], columns[row]
            for j in range(count):
                balance = 2 * (
                    bits[start + (j + 1) % count] + bits[start + (j + count - 1) % count]
                )
                balance -= 2
                for adjacent in (row - 1, row + 1):
                    if 0 <= adjacent < len(columns) and columns[adjacent] > 0:
                        column = starts[adjacent] + (j * columns[adjacent]) // count
                        balance += 2 * bits[column] - 1
                bits[start + j] = 1 if gains[start + j] + edge_cost * balance > 0 else 0


def _lies_on_map(unrolled: UnrolledMap, xyz: Floats) -> Mask:
    surface = unrolled.surface
    arc_length, azimuth, _, _ = surface.coordinates(xyz)
    columns = surface.columns_per_row()
    row = np.floor(arc_length).astype(np.int64) - surface.first_row
    is_inside = (row >= 0) & (row < surface.row_count)
    row = row.clip(0, max(surface.row_count - 1, 0))
    column = np.floor(azimuth % (2 * np.pi) / (2 * np.pi) * columns[row]).astype(np.int64)
    column = np.minimum(column, columns[row] - 1)
    starts = np.cumsum(columns) - columns
    is_inside &= column >= 0
    is_occupied = np.zeros(len(xyz), bool)
    is_occupied[is_inside] = unrolled.bits[starts[row[is_inside]] + column[is_inside]] == 1
    return is_occupied

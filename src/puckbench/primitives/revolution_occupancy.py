"""Occupancy maps of surfaces of revolution, decided by the encoder; samples left to planes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats
from puckbench.primitives.manhattan_frame import rotated
from puckbench.primitives.octree_arrays import Bytes, Ints
from puckbench.primitives.revolution import (
    MAX_COLUMNS,
    RevolutionSurface,
    is_representable,
    pack_parameters,
    sample_surface,
    unpack_parameters,
)
from puckbench.primitives.shape_detection import bounded_inliers, clip_to_inliers

Mask = NDArray[np.bool_]


class UnrolledMap(NamedTuple):
    """A surface of revolution as a stream has it, and its occupancy map (columns,)."""

    surface: RevolutionSurface
    bits: Bytes


class RevolutionCosts(NamedTuple):
    """Squared errors and lengths, in cells, by which the encoder decides.

    omission_error: of a sample that no column represents. tangential_weight: weight of the squared
    distance beyond a sampling cell. max_error: bound of the squared error. tolerance: distance of
    an inlier. spacing: side of a sampling cell. edge_cost: of two unlike columns side by side.
    """

    omission_error: float
    tangential_weight: float
    max_error: float
    tolerance: float
    spacing: float
    edge_cost: float


def to_grid(
    surface: RevolutionSurface,
    rotation: Floats,
    corner: Floats,
    cell: float,
    margins: tuple[float, float, float],
) -> RevolutionSurface:
    """A surface in the cloud's units, in cells of a grid that is rotated and begins at `corner`."""
    origin, axis = rotated(np.stack([surface.origin, surface.axis]), rotation)
    origin = (origin - corner) / cell + margins
    return surface._replace(origin=origin, axis=axis, radius=surface.radius / cell)


def fit_revolutions(
    surfaces: list[RevolutionSurface],
    xyz: Floats,
    normals: Floats,
    weights: Floats,
    costs: RevolutionCosts,
) -> tuple[list[UnrolledMap], Mask]:
    """Fit surfaces and their occupancy maps to samples, one after the other.

    Parameters
    ----------
    surfaces
        Detected surfaces, in cells.
    xyz, normals, weights
        Samples (n, 3) in cells, their normals, and their weights (n,) relative to their area.
    costs
        What the encoder decides by.

    Returns
    -------
    maps : list of UnrolledMap
        Those surfaces that explain samples.
    unexplained : ndarray
        (n,) mask of the samples that no surface explains.
    """
    unexplained = np.ones(len(xyz), bool)
    maps: list[UnrolledMap] = []
    for wanted in surfaces:
        bound = clip_to_inliers(wanted, xyz, normals, unexplained, costs.tolerance)
        if bound.rows == 0 or not is_representable(bound):
            continue
        (surface,) = unpack_parameters(pack_parameters(bound))
        rows = np.flatnonzero(unexplained & bounded_inliers(surface, xyz, normals, costs.tolerance))
        if not len(rows):
            continue
        columns = sum(len(unrolled.bits) for unrolled in maps) + int(surface.columns().sum())
        if columns > MAX_COLUMNS:
            continue
        bits = _decide_columns(surface, xyz[rows], normals[rows], weights[rows], costs)
        explained = rows[_lies_on_map(surface, bits, xyz[rows])]
        if len(explained):
            maps.append(UnrolledMap(surface, bits))
            unexplained[explained] = False
    return maps, unexplained


def _decide_columns(
    surface: RevolutionSurface,
    xyz: Floats,
    normals: Floats,
    weights: Floats,
    costs: RevolutionCosts,
) -> Bytes:
    """Occupancy map of the columns whose centre saves more distortion than it adds."""
    from scipy.spatial import cKDTree

    middles, _ = sample_surface(surface, np.ones(int(surface.columns().sum()), np.uint8), 1, 1)
    distance, nearest = cKDTree(xyz).query(middles)
    normal_distance = ((middles - xyz[nearest]) * normals[nearest]).sum(axis=1)
    beyond = np.maximum(distance - costs.spacing, 0)
    error = np.minimum(normal_distance**2 + costs.tangential_weight * beyond**2, costs.max_error)
    saved = np.where(beyond == 0, costs.omission_error * weights[nearest], 0.0)
    bits: Bytes = (saved > error).astype(np.uint8)
    _optimise_map(saved - error, surface.columns(), costs.edge_cost, bits)
    return bits


@compiled
def _optimise_map(gains: Floats, columns: Ints, edge_cost: float, bits: Bytes) -> None:
    """Iterated conditional modes (Besag 1986), at `edge_cost` for each unlike neighbour."""
    starts = np.zeros(len(columns) + 1, np.int64)
    for row in range(len(columns)):
        starts[row + 1] = starts[row] + columns[row]
    for _ in range(4):
        for row in range(len(columns)):
            start, count = starts[row], columns[row]
            for j in range(count):
                balance = 2 * (
                    bits[start + (j + 1) % count] + bits[start + (j + count - 1) % count]
                )
                balance -= 2
                for beside in (row - 1, row + 1):
                    if 0 <= beside < len(columns) and columns[beside] > 0:
                        at = starts[beside] + (j * columns[beside]) // count
                        balance += 2 * bits[at] - 1
                bits[start + j] = 1 if gains[start + j] + edge_cost * balance > 0 else 0


def _lies_on_map(surface: RevolutionSurface, bits: Bytes, xyz: Floats) -> Mask:
    """Mask of the points that lie on occupied columns."""
    arc_length, azimuth, _, _ = surface.coordinates(xyz)
    columns = surface.columns()
    row = np.floor(arc_length).astype(np.int64) - surface.first_row
    inside = (row >= 0) & (row < surface.rows)
    row = row.clip(0, max(surface.rows - 1, 0))
    column = np.floor(azimuth % (2 * np.pi) / (2 * np.pi) * columns[row]).astype(np.int64)
    column = np.minimum(column, columns[row] - 1)
    starts = np.cumsum(columns) - columns
    on = np.zeros(len(xyz), bool)
    valid = inside & (column >= 0)
    on[valid] = bits[starts[row[valid]] + column[valid]] == 1
    return on

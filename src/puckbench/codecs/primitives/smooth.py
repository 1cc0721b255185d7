"""Samples of a noisy surface, moved onto the robust local planes of their surroundings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.moments import SIZE, add_point, fit_plane
from puckbench.codecs.primitives.tree import cell_starts
from puckbench.compiling import compiled

Ints = NDArray[np.int64]


class Samples(NamedTuple):
    """Means of the points of each cell: xyz (n, 3), counts (n,), cells (n, 3)."""

    xyz: Floats
    counts: Floats
    cells: Ints


def sampled(points: Floats, cell: float) -> Samples:
    """One sample for each cubic cell that holds points; cells count from the origin."""
    order, starts = cell_starts(points, cell)
    counts = np.diff(np.concatenate([starts, [len(points)]])).astype(np.float64)
    sums = np.add.reduceat(points[order], starts, axis=0)
    return Samples(
        sums / counts[:, None], counts, np.floor(points[order[starts]] / cell).astype(np.int64)
    )


def smoothed(samples: Samples, cell: float, radius: float, band: float) -> tuple[Floats, Floats]:
    """Samples moved along the normal onto the robust plane of those within `radius`; normals.

    Neighbours weigh by the root of their counts (noise is correlated among them), less with
    distance, and not at all beyond `band` from the plane (Tukey's biweight). That is done twice,
    the second time with those whose normals came out alike, which keeps away what lies beyond an
    edge.
    """
    around = _surroundings(samples)
    moved, normals = samples.xyz, np.zeros_like(samples.xyz)
    for _ in range(_PASSES):
        known, moved, normals = (moved, normals), np.empty_like(moved), np.empty_like(moved)
        _smooth(around, int(np.ceil(radius / cell)), (radius, band), known, moved, normals)
    return moved, normals


_PASSES = 2
_ROUNDS = 2
"""How often neighbours are weighed by their distances from the plane, each time."""
_ALIKE = float(np.cos(np.radians(35)))
"""Cosine of the angle of normals from which on a neighbour counts, the more the more alike."""


class Surroundings(NamedTuple):
    """Samples (n, 3) by cells (n, 3), x first and z last, and their weights (n,).

    columns: where the samples of a column of cells (x, y) begin, and where the last ends; (a, b).
    """

    xyz: Floats
    weights: Floats
    cells: Ints
    columns: Ints


def _surroundings(samples: Samples) -> Surroundings:
    cells = samples.cells - samples.cells.min(axis=0)
    across = int(cells[:, 1].max()) + 1
    along = int(cells[:, 0].max()) + 1
    column = cells[:, 0] * across + cells[:, 1]
    ends = np.searchsorted(column, np.arange(along * across + 1))
    starts = np.lib.stride_tricks.sliding_window_view(ends, across + 1)[::across]
    return Surroundings(samples.xyz, np.sqrt(samples.counts), cells, starts.copy())


@compiled
def _smooth(
    around: Surroundings,
    reach: int,
    settings: tuple[float, float],
    known: tuple[Floats, Floats],
    moved: Floats,
    normals: Floats,
) -> None:
    """reach: radius in cells. settings: radius, band. known: places, normals (or zeros)."""
    xyz = around.xyz
    near = np.empty(((2 * reach + 1) ** 3, 4))
    plane = np.empty(4)
    for i in range(len(xyz)):
        count = _neighbours(around, i, reach, settings[0], known[1], near)
        for a in range(3):
            plane[a] = known[1][i, a]
        plane[3] = 0.0
        for a in range(3):
            plane[3] += plane[a] * (known[0][i, a] - xyz[i, a])
        _robust_plane(near[:count], settings[1], plane)
        for a in range(3):
            moved[i, a] = xyz[i, a] + plane[3] * plane[a]
            normals[i, a] = plane[a]


@compiled
def _neighbours(
    around: Surroundings,
    i: int,
    reach: int,
    radius: float,
    normals: Floats,
    near: Floats,
) -> int:
    """List where the samples around one lie from it, and their weights; how many."""
    xyz, cells, columns = around.xyz, around.cells, around.columns
    own, cell = normals[i], cells[i]
    blank = own[0] == 0.0 and own[1] == 0.0 and own[2] == 0.0
    count = 0
    for x in range(max(cell[0] - reach, 0), min(cell[0] + reach + 1, columns.shape[0])):
        for y in range(max(cell[1] - reach, 0), min(cell[1] + reach + 1, columns.shape[1] - 1)):
            begin, end = columns[x, y], columns[x, y + 1]
            for j in range(_first_from(cells, begin, end, cell[2] - reach), end):
                if cells[j, 2] > cell[2] + reach:
                    break
                squared = along = 0.0
                for a in range(3):
                    squared += (xyz[j, a] - xyz[i, a]) ** 2
                    along += own[a] * normals[j, a]
                alike = 1.0 if blank else (abs(along) - _ALIKE) / (1 - _ALIKE)
                if squared < radius * radius and alike > 0.0:
                    for a in range(3):
                        near[count, a] = xyz[j, a] - xyz[i, a]
                    distance = 1 - squared / (radius * radius)
                    near[count, 3] = around.weights[j] * distance * alike * alike
                    count += 1
    return count


@compiled
def _first_from(cells: Ints, begin: int, end: int, least: int) -> int:
    """The first of a column's samples that lies at `least` or above."""
    while begin < end:
        middle = (begin + end) // 2
        if cells[middle, 2] < least:
            begin = middle + 1
        else:
            end = middle
    return begin


@compiled
def _robust_plane(near: Floats, band: float, plane: Floats) -> None:
    """Plane of neighbours (n, 3) and their weights, reweighted by their distance from it.

    plane: where to begin, or all zeros; left as it is where no neighbour counts.
    """
    moments = np.zeros(SIZE)
    for _ in range(_ROUNDS):
        moments[:] = 0.0
        for k in range(len(near)):
            x, y, z, weight = near[k]
            u = (-plane[3] + plane[0] * x + plane[1] * y + plane[2] * z) / band
            if abs(u) < 1:
                add_point(moments, x, y, z, weight * (1 - u * u) ** 2)
        if moments[0] <= 0.0:
            return
        fit_plane(moments, plane)

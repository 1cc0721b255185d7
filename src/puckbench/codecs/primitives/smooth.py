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


def smoothed(
    samples: Samples, cell: float, radius: float, band: float, rounds: int = 4
) -> tuple[Floats, Floats]:
    """Samples moved along the normal onto the robust plane of those within `radius`; normals.

    Neighbours weigh by the root of their counts (noise is correlated among them), less with
    distance, and not at all beyond `band` from the plane (Tukey's biweight).
    """
    reach = int(np.ceil(radius / cell))
    low = samples.cells.min(axis=0) - reach
    size = samples.cells.max(axis=0) + reach + 1 - low
    index = np.full(size, -1, np.int32)
    index[tuple((samples.cells - low).T)] = np.arange(len(samples.cells))
    offsets = _ball(reach, radius / cell)
    moved, normals = np.empty_like(samples.xyz), np.empty_like(samples.xyz)
    weights = np.sqrt(samples.counts)
    places = samples.cells - low
    _smooth(samples.xyz, weights, places, index, offsets, radius, band, rounds, moved, normals)
    return moved, normals


def _ball(reach: int, radius: float) -> Ints:
    span = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(span, span, span, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(offsets[(offsets**2).sum(axis=1) <= (radius + 0.5) ** 2])


@compiled
def _smooth(
    xyz: Floats,
    weights: Floats,
    places: Ints,
    index: NDArray[np.int32],
    offsets: Ints,
    radius: float,
    band: float,
    rounds: int,
    moved: Floats,
    normals: Floats,
) -> None:
    near = np.empty(len(offsets), np.int64)
    base = np.empty(len(offsets))
    plane = np.empty(4)
    for i in range(len(xyz)):
        count = 0
        for k in range(len(offsets)):
            j = index[
                places[i, 0] + offsets[k, 0],
                places[i, 1] + offsets[k, 1],
                places[i, 2] + offsets[k, 2],
            ]
            if j >= 0:
                squared = 0.0
                for a in range(3):
                    squared += (xyz[j, a] - xyz[i, a]) ** 2
                if squared < radius * radius:
                    near[count] = j
                    base[count] = weights[j] * (1 - squared / (radius * radius))
                    count += 1
        _robust_plane(xyz, xyz[i], near[:count], base[:count], band, rounds, plane)
        for a in range(3):
            moved[i, a] = xyz[i, a] + plane[3] * plane[a]
            normals[i, a] = plane[a]


@compiled
def _robust_plane(
    xyz: Floats, centre: Floats, near: Ints, base: Floats, band: float, rounds: int, plane: Floats
) -> None:
    """Plane, relative to `centre`, of the neighbours, reweighted `rounds` times."""
    moments = np.zeros(SIZE)
    robust = np.ones(len(near))
    for _ in range(rounds):
        moments[:] = 0.0
        for k in range(len(near)):
            p = xyz[near[k]]
            weight = base[k] * robust[k]
            add_point(moments, p[0] - centre[0], p[1] - centre[1], p[2] - centre[2], weight)
        if moments[0] <= 0.0:
            return
        fit_plane(moments, plane)
        for k in range(len(near)):
            p = xyz[near[k]]
            off = -plane[3]
            for a in range(3):
                off += plane[a] * (p[a] - centre[a])
            u = off / band
            robust[k] = (1 - u * u) ** 2 if abs(u) < 1 else 0.0

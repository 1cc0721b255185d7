"""Samples of a noisy surface, moved onto the robust local planes of their surroundings."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives.tree import cell_starts
from puckbench.core.compiling import compiled
from puckbench.core.threads import in_threads
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import SIZE, add_point, fit_plane

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
    reach = int(np.ceil(radius / cell))
    order, around = _surroundings(samples, max(_LEAST_BLOCK, -(-reach // 2)))
    moved, normals = around.xyz, np.zeros_like(around.xyz)
    for _ in range(_PASSES):
        known, moved, normals = (moved, normals), np.empty_like(moved), np.empty_like(moved)
        run = partial(_smooth, around, reach, (radius, band), known, moved, normals)
        in_threads(run, _parts(around))
    found = np.empty((2, *moved.shape))
    found[:, order] = moved, normals
    return found[0], found[1]


_PASSES = 2
_ROUNDS = 2
"""How often neighbours are weighed by their distances from the plane, each time."""
_ALIKE = float(np.cos(np.radians(35)))
"""Cosine of the angle of normals from which on a neighbour counts, the more the more alike."""
_LEAST_BLOCK = 3
"""Cells along a block's side, at least."""
_PART = 8192
"""Samples, about, that a thread takes at a time."""


class Surroundings(NamedTuple):
    """Samples (n, 3) and their weights (n,), those of a cubic block of cells together.

    size: cells along a block's side. shape: blocks along each axis. starts: (blocks + 1,) where the
    samples of each block begin, z running fastest.
    """

    xyz: Floats
    weights: Floats
    size: int
    shape: tuple[int, int, int]
    starts: Ints


def _surroundings(samples: Samples, size: int) -> tuple[Ints, Surroundings]:
    """The samples by blocks, after the order (n,) that brings them there."""
    blocks = (samples.cells - samples.cells.min(axis=0)) // size
    x, y, z = (blocks.max(axis=0) + 1).tolist()
    block = (blocks[:, 0] * y + blocks[:, 1]) * z + blocks[:, 2]
    order = np.argsort(block, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(block, minlength=x * y * z))])
    weights = np.sqrt(samples.counts[order])
    return order, Surroundings(samples.xyz[order], weights, size, (x, y, z), starts)


def _parts(around: Surroundings) -> list[tuple[int, int]]:
    """Ranges of blocks with some samples each."""
    begins = np.searchsorted(around.starts, np.arange(0, len(around.xyz), _PART), "right") - 1
    ends = [*begins[1:].tolist(), len(around.starts) - 1]
    return list(zip(begins.tolist(), ends, strict=True))


@compiled
def _smooth(
    around: Surroundings,
    reach: int,
    settings: tuple[float, float],
    known: tuple[Floats, Floats],
    moved: Floats,
    normals: Floats,
    part: tuple[int, int],
) -> None:
    """Smooth the samples of a part: those from a block to before another.

    reach: radius in cells. settings: radius, band. known: places, normals (or zeros).
    """
    xyz, own = around.xyz, known[1]
    blocks = -(-reach // around.size)
    runs = np.empty(((2 * blocks + 1) ** 2, 2), np.int64)
    near = np.empty((0, 4))
    plane = np.empty(4)
    for block in range(part[0], part[1]):
        begin, end = around.starts[block], around.starts[block + 1]
        if begin == end:
            continue
        found = _runs_near(around, block, blocks, runs)
        most = (found[:, 1] - found[:, 0]).sum()
        if len(near) < most:
            near = np.empty((2 * most, 4))
        for i in range(begin, end):
            count = _neighbours(around, i, found, settings[0], own, near)
            for a in range(3):
                plane[a] = own[i, a]
            plane[3] = 0.0
            for a in range(3):
                plane[3] += plane[a] * (known[0][i, a] - xyz[i, a])
            _robust_plane(near[:count], settings[1], plane)
            for a in range(3):
                moved[i, a] = xyz[i, a] + plane[3] * plane[a]
                normals[i, a] = plane[a]


@compiled
def _runs_near(around: Surroundings, block: int, reach: int, runs: Ints) -> Ints:
    """Where the samples of the blocks within `reach` blocks begin and end, those along z in one."""
    _, across, up = around.shape
    x, y, z = block // (across * up), block // up % across, block % up
    count = 0
    for i in range(max(x - reach, 0), min(x + reach + 1, around.shape[0])):
        for j in range(max(y - reach, 0), min(y + reach + 1, across)):
            column = (i * across + j) * up
            begin = around.starts[column + max(z - reach, 0)]
            end = around.starts[column + min(z + reach + 1, up)]
            if begin < end:
                runs[count, 0], runs[count, 1] = begin, end
                count += 1
    return runs[:count]


@compiled
def _neighbours(
    around: Surroundings, i: int, runs: Ints, radius: float, normals: Floats, near: Floats
) -> int:
    """List where the samples around one lie from it, and their weights; how many.

    All of the runs are written to `near`, each over the one before if that does not count.
    """
    xyz = around.xyz
    a, b, c = normals[i]
    blank = a == 0.0 and b == 0.0 and c == 0.0
    nearer, count = 1 / (radius * radius), 0
    for k in range(len(runs)):
        for j in range(runs[k, 0], runs[k, 1]):
            x, y, z = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
            weight = 1 - (x * x + y * y + z * z) * nearer
            along = abs(a * normals[j, 0] + b * normals[j, 1] + c * normals[j, 2])
            alike = 1.0 if blank else (along - _ALIKE) / (1 - _ALIKE)
            near[count, 0], near[count, 1], near[count, 2] = x, y, z
            near[count, 3] = around.weights[j] * weight * alike * alike
            count += (weight > 0.0) & (alike > 0.0)
    return count


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

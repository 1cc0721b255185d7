"""Smoothing of noisy surfaces: samples are projected onto robust local planes of their neighbours.

That is a moving-least-squares projection with Tukey's biweight as the robust weight.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives.octree import group_by_cell
from puckbench.core.compiling import compiled
from puckbench.core.threads import in_threads
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import SIZE, add_point, fit_plane

Ints = NDArray[np.int64]


class Samples(NamedTuple):
    """Means of the points of each sampling cell: xyz (n, 3), counts (n,), cells (n, 3)."""

    xyz: Floats
    counts: Floats
    cells: Ints


def sample_cells(points: Floats, cell: float) -> Samples:
    """One sample, the mean of the points, for each cubic cell of side `cell` that holds points."""
    order, starts = group_by_cell(points, cell)
    counts = np.diff(np.concatenate([starts, [len(points)]])).astype(np.float64)
    sums = np.add.reduceat(points[order], starts, axis=0)
    return Samples(
        sums / counts[:, None], counts, np.floor(points[order[starts]] / cell).astype(np.int64)
    )


def smooth_samples(
    samples: Samples, cell: float, radius: float, band: float
) -> tuple[Floats, Floats]:
    """Project samples onto the robust planes of their neighbours.

    Neighbours weigh by the root of their counts (noise is correlated among them), less with
    distance, and nothing beyond `band` from the plane (Tukey's biweight). The second of two passes
    weighs them by the similarity of their normals too, which preserves edges.

    Parameters
    ----------
    samples
        One for each sampling cell.
    cell
        Side of a sampling cell.
    radius
        Radius of the neighbourhood.
    band
        Distance from the plane from which on neighbours are outliers.

    Returns
    -------
    xyz, normals
        (n, 3) projected samples and their unit normals.
    """
    reach = int(np.ceil(radius / cell))
    order, blocked = _blocked(samples, max(_MIN_BLOCK, -(-reach // 2)))
    displace, normals = blocked.xyz, np.zeros_like(blocked.xyz)
    for _ in range(_PASSES):
        previous, displace, normals = (
            (displace, normals),
            np.empty_like(displace),
            np.empty_like(displace),
        )
        run = partial(_smooth, blocked, reach, (radius, band), previous, displace, normals)
        in_threads(run, _tasks(blocked))
    found = np.empty((2, *displace.shape))
    found[:, order] = displace, normals
    return found[0], found[1]


_PASSES = 2
_REWEIGHTINGS = 2
"""How often neighbours are weighed by their distances from the plane, in each pass."""
_MIN_COSINE = float(np.cos(np.radians(35)))
"""Cosine of the angle between normals from which on a neighbour counts."""
_MIN_BLOCK = 3
"""Cells along a block's side, at least."""
_SAMPLES_PER_TASK = 8192
"""Samples, about, that a thread smooths at a time."""


class BlockedSamples(NamedTuple):
    """Samples (n, 3) and their weights (n,), sorted by cubic blocks of sampling cells.

    size: cells along a block's side. shape: blocks along each axis. starts: (blocks + 1,) index of
    the first sample of each block, z running fastest.
    """

    xyz: Floats
    weights: Floats
    size: int
    shape: tuple[int, int, int]
    starts: Ints


def _blocked(samples: Samples, size: int) -> tuple[Ints, BlockedSamples]:
    """The samples by blocks, after the order (n,) that sorts them so."""
    blocks = (samples.cells - samples.cells.min(axis=0)) // size
    x, y, z = (blocks.max(axis=0) + 1).tolist()
    block = (blocks[:, 0] * y + blocks[:, 1]) * z + blocks[:, 2]
    order = np.argsort(block, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(block, minlength=x * y * z))])
    weights = np.sqrt(samples.counts[order])
    return order, BlockedSamples(samples.xyz[order], weights, size, (x, y, z), starts)


def _tasks(blocked: BlockedSamples) -> list[tuple[int, int]]:
    """Ranges of blocks with some samples each."""
    begins = (
        np.searchsorted(blocked.starts, np.arange(0, len(blocked.xyz), _SAMPLES_PER_TASK), "right")
        - 1
    )
    ends = [*begins[1:].tolist(), len(blocked.starts) - 1]
    return list(zip(begins.tolist(), ends, strict=True))


@compiled
def _smooth(
    blocked: BlockedSamples,
    reach: int,
    radii: tuple[float, float],
    previous: tuple[Floats, Floats],
    displace: Floats,
    normals: Floats,
    task: tuple[int, int],
) -> None:
    """Smooth the samples of the blocks from task[0] to before task[1].

    reach: radius in cells. radii: radius, band. previous: samples and normals (or zeros) of the
    last pass. moved, normals: (n, 3), written.
    """
    xyz, previous_normals = blocked.xyz, previous[1]
    blocks = -(-reach // blocked.size)
    runs = np.empty(((2 * blocks + 1) ** 2, 2), np.int64)
    neighbours = np.empty((0, 4))
    plane = np.empty(4)
    for block in range(task[0], task[1]):
        begin, end = blocked.starts[block], blocked.starts[block + 1]
        if begin == end:
            continue
        found = _runs_near(blocked, block, blocks, runs)
        capacity = (found[:, 1] - found[:, 0]).sum()
        if len(neighbours) < capacity:
            neighbours = np.empty((2 * capacity, 4))
        for i in range(begin, end):
            count = _list_neighbours(blocked, i, found, radii[0], previous_normals, neighbours)
            for a in range(3):
                plane[a] = previous_normals[i, a]
            plane[3] = 0.0
            for a in range(3):
                plane[3] += plane[a] * (previous[0][i, a] - xyz[i, a])
            _robust_plane(neighbours[:count], radii[1], plane)
            for a in range(3):
                displace[i, a] = xyz[i, a] + plane[3] * plane[a]
                normals[i, a] = plane[a]


@compiled
def _runs_near(blocked: BlockedSamples, block: int, reach: int, runs: Ints) -> Ints:
    """Ranges of the samples within `reach` blocks of one, blocks along z as one range."""
    _, across, up = blocked.shape
    x, y, z = block // (across * up), block // up % across, block % up
    count = 0
    for i in range(max(x - reach, 0), min(x + reach + 1, blocked.shape[0])):
        for j in range(max(y - reach, 0), min(y + reach + 1, across)):
            column = (i * across + j) * up
            begin = blocked.starts[column + max(z - reach, 0)]
            end = blocked.starts[column + min(z + reach + 1, up)]
            if begin < end:
                runs[count, 0], runs[count, 1] = begin, end
                count += 1
    return runs[:count]


@compiled
def _list_neighbours(
    blocked: BlockedSamples, i: int, runs: Ints, radius: float, normals: Floats, neighbours: Floats
) -> int:
    """Write offsets and weights (n, 4) of the neighbours of sample i; their number.

    All samples of the runs are written, each over the one before if that one does not count.
    """
    xyz = blocked.xyz
    a, b, c = normals[i]
    no_normal = a == 0.0 and b == 0.0 and c == 0.0
    inverse_square, count = 1 / (radius * radius), 0
    for k in range(len(runs)):
        for j in range(runs[k, 0], runs[k, 1]):
            x, y, z = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
            weight = 1 - (x * x + y * y + z * z) * inverse_square
            along = abs(a * normals[j, 0] + b * normals[j, 1] + c * normals[j, 2])
            similarity = 1.0 if no_normal else (along - _MIN_COSINE) / (1 - _MIN_COSINE)
            neighbours[count, 0], neighbours[count, 1], neighbours[count, 2] = x, y, z
            neighbours[count, 3] = blocked.weights[j] * weight * similarity * similarity
            count += (weight > 0.0) & (similarity > 0.0)
    return count


@compiled
def _robust_plane(neighbours: Floats, band: float, plane: Floats) -> None:
    """Fit a plane to neighbours (n, 4), reweighted by their distances from it.

    plane: (4,) the plane to begin with, or zeros; unchanged if no neighbour counts.
    """
    moments = np.zeros(SIZE)
    for _ in range(_REWEIGHTINGS):
        moments[:] = 0.0
        for k in range(len(neighbours)):
            x, y, z, weight = neighbours[k]
            u = (-plane[3] + plane[0] * x + plane[1] * y + plane[2] * z) / band
            if abs(u) < 1:
                add_point(moments, x, y, z, weight * (1 - u * u) ** 2)
        if moments[0] <= 0.0:
            return
        fit_plane(moments, plane)

"""Smoothing of noisy surfaces: samples are projected onto robust local planes of their neighbours.

That is a moving-least-squares projection with Tukey's biweight as the robust weight.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.core.threads import in_threads
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import MOMENT_COUNT, fit_plane
from puckbench.primitives.cells import group_by_cell

Ints = NDArray[np.int64]


class Samples(NamedTuple):
    """Means of the points of each sampling cell: xyz (n, 3), counts (n,), cells (n, 3)."""

    xyz: Floats
    counts: Floats
    cells: Ints


def sample_cells(points: Floats, cell: float) -> Samples:
    """One sample, the mean of the points, for each cubic cell of side `cell` that holds points."""
    groups = group_by_cell(points, cell)
    order, starts = groups.order()
    sums = np.add.reduceat(points[order], starts, axis=0)
    return Samples(sums / groups.counts[:, None], groups.counts, groups.cells)


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
    order, blocked = blocks_of(samples, max(_MIN_BLOCK, -(-reach // 2)))
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


def blocks_of(samples: Samples, size: int) -> tuple[Ints, BlockedSamples]:
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
    candidates, neighbours = np.empty((7, 0)), np.empty((5, 0))
    plane = np.empty(4)
    for block in range(task[0], task[1]):
        begin, end = blocked.starts[block], blocked.starts[block + 1]
        if begin == end:
            continue
        found = runs_near(blocked, block, blocks, runs)
        capacity = (found[:, 1] - found[:, 0]).sum()
        if candidates.shape[1] < capacity:
            candidates, neighbours = np.empty((7, 2 * capacity)), np.empty((5, 2 * capacity))
        near = _list_candidates(
            blocked, (begin, end), found, radii[0], previous_normals, candidates
        )
        for i in range(begin, end):
            count = _list_neighbours(
                candidates, near, xyz[i], previous_normals[i], radii[0], neighbours
            )
            for a in range(3):
                plane[a] = previous_normals[i, a]
            plane[3] = 0.0
            for a in range(3):
                plane[3] += plane[a] * (previous[0][i, a] - xyz[i, a])
            _robust_plane(neighbours, count, radii[1], plane)
            for a in range(3):
                displace[i, a] = xyz[i, a] + plane[3] * plane[a]
                normals[i, a] = plane[a]


@compiled
def runs_near(blocked: BlockedSamples, block: int, reach: int, runs: Ints) -> Ints:
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
def _list_candidates(
    blocked: BlockedSamples,
    rows: tuple[int, int],
    runs: Ints,
    radius: float,
    normals: Floats,
    candidates: Floats,
) -> int:
    """Write the samples of the runs within the radius of a box around some rows; their number.

    candidates: (7, n) coordinates, weights and normals.
    """
    xyz, count = blocked.xyz, 0
    low, high = xyz[rows[0]].copy(), xyz[rows[0]].copy()
    for i in range(rows[0] + 1, rows[1]):
        for a in range(3):
            low[a], high[a] = min(low[a], xyz[i, a]), max(high[a], xyz[i, a])
    farthest = (1.001 * radius) ** 2
    for k in range(len(runs)):
        for j in range(runs[k, 0], runs[k, 1]):
            squared = 0.0
            for a in range(3):
                beyond = max(low[a] - xyz[j, a], xyz[j, a] - high[a], 0.0)
                squared += beyond * beyond
                candidates[a, count] = xyz[j, a]
                candidates[4 + a, count] = normals[j, a]
            candidates[3, count] = blocked.weights[j]
            count += squared < farthest
    return count


@compiled
def _list_neighbours(
    candidates: Floats, count: int, own: Floats, normal: Floats, radius: float, neighbours: Floats
) -> int:
    """Write offsets and weights (4, n) of the neighbours of a sample; their number.

    neighbours: (5, n); the last row is scratch. Each step is a loop of its own, over whole rows,
    for the processor's vector instructions.
    """
    p, q, r = own
    a, b, c = normal
    x, y, z, weights = candidates[0], candidates[1], candidates[2], candidates[3]
    found, inverse_square = neighbours[4], 1 / (radius * radius)
    for j in range(count):
        u, v, w = x[j] - p, y[j] - q, z[j] - r
        weight = 1 - (u * u + v * v + w * w) * inverse_square
        found[j] = weights[j] * weight if weight > 0.0 else 0.0
    if a != 0.0 or b != 0.0 or c != 0.0:
        d, e, f = candidates[4], candidates[5], candidates[6]
        for j in range(count):
            along = abs(a * d[j] + b * e[j] + c * f[j])
            similarity = (along - _MIN_COSINE) / (1 - _MIN_COSINE)
            found[j] = found[j] * similarity * similarity if similarity > 0.0 else 0.0
    kept = 0
    for j in range(count):
        neighbours[0, kept], neighbours[1, kept] = x[j] - p, y[j] - q
        neighbours[2, kept], neighbours[3, kept] = z[j] - r, found[j]
        kept += found[j] > 0.0
    return kept


@compiled
def _robust_plane(neighbours: Floats, count: int, band: float, plane: Floats) -> None:
    """Fit a plane to neighbours (4, count), reweighted by their distances from it.

    neighbours: (5, n); the last row is scratch. plane: (4,) the plane to begin with, or zeros;
    unchanged if no neighbour counts.
    """
    x, y, z, weights = neighbours[0], neighbours[1], neighbours[2], neighbours[3]
    found = neighbours[4]
    moments = np.empty(MOMENT_COUNT)
    for _ in range(_REWEIGHTINGS):
        a, b, c, d = plane
        for k in range(count):
            u = (-d + a * x[k] + b * y[k] + c * z[k]) / band
            found[k] = weights[k] * (1 - u * u) ** 2 if abs(u) < 1 else 0.0
        _sum_moments(x, y, z, found, count, moments)
        if moments[0] <= 0.0:
            return
        fit_plane(moments, plane)


@compiled
def _sum_moments(
    x: Floats, y: Floats, z: Floats, weights: Floats, count: int, moments: Floats
) -> None:
    """Write the moments (10,) of weighted points, summed one after the other."""
    s = s_x = s_y = s_z = s_xx = s_xy = s_xz = s_yy = s_yz = s_zz = 0.0
    for k in range(count):
        u, v, w, weight = x[k], y[k], z[k], weights[k]
        along_x, along_y, along_z = weight * u, weight * v, weight * w
        s += weight
        s_x += along_x
        s_y += along_y
        s_z += along_z
        s_xx += along_x * u
        s_xy += along_x * v
        s_xz += along_x * w
        s_yy += along_y * v
        s_yz += along_y * w
        s_zz += along_z * w
    moments[0], moments[1], moments[2], moments[3] = s, s_x, s_y, s_z
    moments[4], moments[5], moments[6] = s_xx, s_xy, s_xz
    moments[7], moments[8], moments[9] = s_yy, s_yz, s_zz

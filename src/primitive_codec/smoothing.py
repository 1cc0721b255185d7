"""Smoothing of noisy surfaces by moving least squares with Tukey's biweight."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats
from pointkit.geometry.moments import MOMENT_COUNT, fit_plane
from pointkit.threads import in_threads
from primitive_codec.cells import group_by_cell
from primitive_codec.octree_arrays import Ints


class CellSamples(NamedTuple):
    """Samples of a cloud, one for each occupied cell of a grid."""

    xyz: Floats  # (n, 3) means of the points
    counts: Floats  # (n,) numbers of points
    cells: Ints  # (n, 3)


def downsample(points: Floats, spacing: float) -> CellSamples:
    """Replace the points (n, 3) of each grid cell by their mean, for cells of side `spacing`."""
    groups = group_by_cell(points, spacing)
    order, starts = groups.sorted_rows()
    sums = np.add.reduceat(points[order], starts, axis=0)
    return CellSamples(sums / groups.counts[:, None], groups.counts, groups.cells)


def smooth_samples(
    samples: CellSamples, spacing: float, radius: float, outlier_distance: float
) -> tuple[Floats, Floats]:
    """Move the samples of a noisy surface onto planes that are robustly fitted to their neighbours.

    The weight of a neighbour is proportional to the square root of its number of points, because
    noise is correlated within a cell. The weight decreases with the distance from the sample and
    with the distance from the plane. In the second pass it also decreases with the angle between
    the normals, which preserves edges.

    Parameters
    ----------
    samples
        The samples, one for each occupied cell.
    spacing
        Side of a sampling cell.
    radius
        Distance from the sample at which the weight of a neighbour becomes zero.
    outlier_distance
        Distance from the plane at which the weight of a neighbour becomes zero.

    Returns
    -------
    xyz, normals
        The moved samples and their unit normals, (n, 3) each.
    """
    cell_radius = int(np.ceil(radius / spacing))
    order, blocks = blocks_of(samples, max(_MIN_BLOCK_SIZE, -(-cell_radius // 2)))
    projected, normals = blocks.xyz, np.zeros_like(blocks.xyz)
    for _ in range(_PASSES):
        previous = (projected, normals)
        projected, normals = np.empty_like(projected), np.empty_like(projected)
        radii = (radius, outlier_distance)
        smooth = partial(_smooth, blocks, cell_radius, radii, previous, projected, normals)
        in_threads(smooth, _block_ranges(blocks))
    result = np.empty((2, *projected.shape))
    result[:, order] = projected, normals
    return result[0], result[1]


_PASSES = 2
_REWEIGHTINGS = 2
"""Number of plane fits per pass; weights come from the distances to the previous plane."""
_MIN_COSINE = float(np.cos(np.radians(35)))
"""Cosine between normals below which a neighbour has no weight."""
_MIN_BLOCK_SIZE = 3
"""Least number of cells along a block's side."""
_SAMPLES_PER_TASK = 8192


class BlockedSamples(NamedTuple):
    """Samples sorted by blocks of cells, in which neighbours are found quickly."""

    xyz: Floats  # (n, 3)
    weights: Floats  # (n,)
    size: int  # cells along a block's side
    shape: tuple[int, int, int]  # blocks along each axis
    starts: Ints  # (blocks + 1,) first sample of each block; z runs fastest


def blocks_of(samples: CellSamples, size: int) -> tuple[Ints, BlockedSamples]:
    """Sort samples by blocks of `size` cells along each side.

    Returns
    -------
    order
        Index (n,) of each sorted sample among the given ones.
    blocks
        The sorted samples.
    """
    block_coordinates = (samples.cells - samples.cells.min(axis=0)) // size
    x, y, z = (block_coordinates.max(axis=0) + 1).tolist()
    block = (block_coordinates[:, 0] * y + block_coordinates[:, 1]) * z + block_coordinates[:, 2]
    order = np.argsort(block, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(block, minlength=x * y * z))])
    weights = np.sqrt(samples.counts[order])
    return order, BlockedSamples(samples.xyz[order], weights, size, (x, y, z), starts)


def _block_ranges(blocks: BlockedSamples) -> list[tuple[int, int]]:
    starts = (
        np.searchsorted(blocks.starts, np.arange(0, len(blocks.xyz), _SAMPLES_PER_TASK), "right")
        - 1
    )
    ends = [*starts[1:].tolist(), len(blocks.starts) - 1]
    return list(zip(starts.tolist(), ends, strict=True))


@compiled
def _smooth(
    blocks: BlockedSamples,
    cell_radius: int,
    radii: tuple[float, float],
    previous: tuple[Floats, Floats],
    projected: Floats,
    normals: Floats,
    block_range: tuple[int, int],
) -> None:
    # `radii` are the radius and the outlier distance; `previous` are the previous pass's samples
    # and normals (initially 0).
    xyz, previous_normals = blocks.xyz, previous[1]
    block_radius = -(-cell_radius // blocks.size)
    ranges = np.empty(((2 * block_radius + 1) ** 2, 2), np.int64)
    # Rows are x, y, z, weight, and then a normal (candidates) or scratch memory (neighbours).
    candidates, neighbours = np.empty((7, 0)), np.empty((5, 0))
    plane = np.empty(4)
    for block in range(block_range[0], block_range[1]):
        begin, end = blocks.starts[block], blocks.starts[block + 1]
        if begin == end:
            continue
        near_ranges = ranges_near(blocks, block, block_radius, ranges)
        capacity = (near_ranges[:, 1] - near_ranges[:, 0]).sum()
        if candidates.shape[1] < capacity:
            candidates, neighbours = np.empty((7, 2 * capacity)), np.empty((5, 2 * capacity))
        candidate_count = _list_candidates(
            blocks, (begin, end), near_ranges, radii[0], previous_normals, candidates
        )
        for i in range(begin, end):
            count = _list_neighbours(
                candidates, candidate_count, xyz[i], previous_normals[i], radii[0], neighbours
            )
            for a in range(3):
                plane[a] = previous_normals[i, a]
            plane[3] = 0.0
            for a in range(3):
                plane[3] += plane[a] * (previous[0][i, a] - xyz[i, a])
            _robust_plane(neighbours, count, radii[1], plane)
            for a in range(3):
                projected[i, a] = xyz[i, a] + plane[3] * plane[a]
                normals[i, a] = plane[a]


@compiled
def ranges_near(blocks: BlockedSamples, block: int, block_radius: int, ranges: Ints) -> Ints:
    """Return index ranges of the samples in the blocks around a block.

    Parameters
    ----------
    blocks
        Samples sorted by block.
    block
        Index of the central block.
    block_radius
        Number of blocks to include on each side.
    ranges
        Memory for the result.

    Returns
    -------
    ndarray
        First and exclusive last index of each range, (k, 2).
    """
    _, across, up = blocks.shape
    x, y, z = block // (across * up), block // up % across, block % up
    count = 0
    for i in range(max(x - block_radius, 0), min(x + block_radius + 1, blocks.shape[0])):
        for j in range(max(y - block_radius, 0), min(y + block_radius + 1, across)):
            column = (i * across + j) * up
            begin = blocks.starts[column + max(z - block_radius, 0)]
            end = blocks.starts[column + min(z + block_radius + 1, up)]
            if begin < end:
                ranges[count, 0], ranges[count, 1] = begin, end
                count += 1
    return ranges[:count]


@compiled
def _list_candidates(
    blocks: BlockedSamples,
    row_range: tuple[int, int],
    ranges: Ints,
    radius: float,
    normals: Floats,
    candidates: Floats,
) -> int:
    xyz, count = blocks.xyz, 0
    low, high = xyz[row_range[0]].copy(), xyz[row_range[0]].copy()
    for i in range(row_range[0] + 1, row_range[1]):
        for a in range(3):
            low[a], high[a] = min(low[a], xyz[i, a]), max(high[a], xyz[i, a])
    max_squared = (1.001 * radius) ** 2
    for k in range(len(ranges)):
        for j in range(ranges[k, 0], ranges[k, 1]):
            squared = 0.0
            for a in range(3):
                outside = max(low[a] - xyz[j, a], xyz[j, a] - high[a], 0.0)
                squared += outside * outside
                candidates[a, count] = xyz[j, a]
                candidates[4 + a, count] = normals[j, a]
            candidates[3, count] = blocks.weights[j]
            count += squared < max_squared
    return count


@compiled
def _list_neighbours(
    candidates: Floats,
    count: int,
    sample: Floats,
    normal: Floats,
    radius: float,
    neighbours: Floats,
) -> int:
    # Each step is a separate loop over whole rows, so that the compiler can vectorise it.
    p, q, r = sample
    a, b, c = normal
    x, y, z, weights = candidates[0], candidates[1], candidates[2], candidates[3]
    neighbour_weights, inverse_square = neighbours[4], 1 / (radius * radius)
    for j in range(count):
        u, v, w = x[j] - p, y[j] - q, z[j] - r
        weight = 1 - (u * u + v * v + w * w) * inverse_square
        neighbour_weights[j] = weights[j] * weight if weight > 0.0 else 0.0
    if a != 0.0 or b != 0.0 or c != 0.0:
        d, e, f = candidates[4], candidates[5], candidates[6]
        for j in range(count):
            along = abs(a * d[j] + b * e[j] + c * f[j])
            similarity = (along - _MIN_COSINE) / (1 - _MIN_COSINE)
            neighbour_weights[j] = (
                neighbour_weights[j] * similarity * similarity if similarity > 0.0 else 0.0
            )
    kept = 0
    for j in range(count):
        neighbours[0, kept], neighbours[1, kept] = x[j] - p, y[j] - q
        neighbours[2, kept], neighbours[3, kept] = z[j] - r, neighbour_weights[j]
        kept += neighbour_weights[j] > 0.0
    return kept


@compiled
def _robust_plane(neighbours: Floats, count: int, outlier_distance: float, plane: Floats) -> None:
    """Fit a plane to neighbours (4, count), weighted by distance from the previous plane."""
    # `plane` (4,), initially a plane or zeros, is unchanged if no neighbour has weight.
    x, y, z, weights = neighbours[0], neighbours[1], neighbours[2], neighbours[3]
    robust_weights = neighbours[4]
    moments = np.empty(MOMENT_COUNT)
    for _ in range(_REWEIGHTINGS):
        a, b, c, d = plane
        for k in range(count):
            u = (-d + a * x[k] + b * y[k] + c * z[k]) / outlier_distance
            robust_weights[k] = weights[k] * (1 - u * u) ** 2 if abs(u) < 1 else 0.0
        _sum_moments(x, y, z, robust_weights, count, moments)
        if moments[0] <= 0.0:
            return
        fit_plane(moments, plane)


@compiled
def _sum_moments(
    x: Floats, y: Floats, z: Floats, weights: Floats, count: int, moments: Floats
) -> None:
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

"""Region merging: neighbouring leaves are merged into regions that one plane fits.

The pair of regions that costs least is merged first.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled, inlined
from pointkit.geometry.cloud import Floats
from pointkit.geometry.moments import MOMENT_COUNT, distance_to_fit, fit_plane
from primitive_codec.octree_arrays import IndexGrid, Ints, Leaves


class MergeLimits(NamedTuple):
    """Limits of how much the error may grow in a merge, and of the angle between two planes."""

    fixed: float  # absolute
    per_weight: float  # per unit of weight of the smaller region
    min_cosine: float  # of the angle between the two planes


class _Regions(NamedTuple):
    """Regions, each identified by the index of one of its leaves (union-find)."""

    moments: Floats  # (n, 10)
    planes: Floats  # (n, 4)
    errors: Floats  # (n,) squared distances to the planes
    parent: Ints  # (n,) region that a leaf was merged into, initially itself
    version: Ints  # (n,) number of merges, -1 if part of another region
    scratch: Floats  # (10,) memory for moments


class _Adjacency(NamedTuple):
    first_edge: Ints  # (n,) first entry of each list
    last_edge: Ints  # (n,)
    neighbour: Ints  # (m,) entries
    next_edge: Ints  # (m,)


_Queue = list[tuple[float, int, int, int, int]]
"""Binary heap of pairs of regions: cost of merging, both regions, and their versions when pushed.
"""


def region_moments(moments: Floats, leaves: Leaves, shape: Ints, limits: MergeLimits) -> Floats:
    """Merge leaves into regions, and return the moments (n, 10) of each leaf's region."""
    region_of = merge_regions(moments, adjacent_leaves(leaves, shape), limits)
    sums = np.zeros_like(moments)
    np.add.at(sums, region_of, moments)
    return np.asarray(sums[region_of])


@compiled
def merge_regions(moments: Floats, pairs: Ints, limits: MergeLimits) -> Ints:
    """Merge adjacent parts of a surface into regions, as long as one plane fits each region.

    Parameters
    ----------
    moments
        Moments (n, 10) of the parts, as `octree.moments_of` defines them.
    pairs
        Indices (m, 2) of adjacent parts.
    limits
        How much a merge may cost.

    Returns
    -------
    ndarray
        For each part, the index (n,) of the part that represents its region. Two parts belong to
        the same region if their numbers are equal.
    """
    n = len(moments)
    regions = _Regions(
        moments.copy(),
        np.zeros((n, 4)),
        np.zeros(n),
        np.arange(n),
        np.zeros(n, np.int64),
        np.empty(MOMENT_COUNT),
    )
    for i in range(n):
        if moments[i, 0] > 0:
            regions.errors[i] = fit_plane(moments[i], regions.planes[i])
    adjacency = _build_adjacency(n, pairs)
    queue = [(0.0, 0, 0, 0, 0)]  # numba infers the type of entries from this one
    queue.pop()
    for k in range(len(pairs)):
        a, b = pairs[k]
        cost = _merge_cost(regions, limits, a, b)
        if cost < np.inf:
            heappush(queue, (cost, a, b, 0, 0))
    marks = np.full(n, -1)
    while queue:
        _, a, b, version_a, version_b = heappop(queue)
        if version_a == regions.version[a] and version_b == regions.version[b]:
            _merge(regions, adjacency, a, b)
            _push_neighbours(queue, regions, adjacency, limits, a, marks)
    for i in range(n):
        regions.parent[i] = _root(regions, i)
    return regions.parent


@compiled
def _build_adjacency(n: int, pairs: Ints) -> _Adjacency:
    lists = np.full((2, n), -1)
    adjacency = _Adjacency(
        lists[0], lists[1], pairs[:, ::-1].copy().ravel(), np.full(pairs.size, -1)
    )
    for k in range(pairs.size):
        _append(adjacency, pairs[k // 2, k % 2], k, k)
    return adjacency


@inlined
def _append(adjacency: _Adjacency, a: int, first_edge: int, last_edge: int) -> None:
    if adjacency.first_edge[a] < 0:
        adjacency.first_edge[a] = first_edge
    else:
        adjacency.next_edge[adjacency.last_edge[a]] = first_edge
    adjacency.last_edge[a] = last_edge


@inlined
def _merge(regions: _Regions, adjacency: _Adjacency, a: int, b: int) -> None:
    regions.parent[b] = a
    regions.version[b] = -1
    regions.version[a] += 1
    for k in range(MOMENT_COUNT):
        regions.moments[a, k] += regions.moments[b, k]
    regions.errors[a] = fit_plane(regions.moments[a], regions.planes[a])
    _append(adjacency, a, adjacency.first_edge[b], adjacency.last_edge[b])


@compiled
def _push_neighbours(
    queue: _Queue, regions: _Regions, adjacency: _Adjacency, limits: MergeLimits, a: int,
    marks: Ints,
) -> None:  # fmt: skip
    mark = a * len(marks) + regions.version[a]
    edge, previous = adjacency.first_edge[a], -1
    while edge >= 0:
        c = _root(regions, adjacency.neighbour[edge])
        if c == a or marks[c] == mark:
            if previous < 0:
                adjacency.first_edge[a] = adjacency.next_edge[edge]
            else:
                adjacency.next_edge[previous] = adjacency.next_edge[edge]
        else:
            marks[c] = mark
            cost = _merge_cost(regions, limits, a, c)
            if cost < np.inf:
                heappush(queue, (cost, a, c, regions.version[a], regions.version[c]))
            previous = edge
        edge = adjacency.next_edge[edge]
    adjacency.last_edge[a] = previous


@inlined
def _merge_cost(regions: _Regions, limits: MergeLimits, a: int, b: int) -> float:
    """Return the cost of merging two regions, or infinity if it exceeds the limits."""
    if _cosine(regions.planes, a, b) < limits.min_cosine:
        return np.inf
    smaller = min(regions.moments[a, 0], regions.moments[b, 0])
    allowed = limits.fixed + limits.per_weight * smaller
    added = _joint_error(regions, a, b) - (regions.errors[a] + regions.errors[b])
    return float(added / allowed) if added <= allowed else np.inf


@inlined
def _cosine(planes: Floats, a: int, b: int) -> float:
    along = planes[a, 0] * planes[b, 0] + planes[a, 1] * planes[b, 1]
    return float(abs(along + planes[a, 2] * planes[b, 2]))


@inlined
def _joint_error(regions: _Regions, a: int, b: int) -> float:
    moments = regions.scratch
    for k in range(MOMENT_COUNT):
        moments[k] = regions.moments[a, k] + regions.moments[b, k]
    return distance_to_fit(moments)


@inlined
def _root(regions: _Regions, i: int) -> int:
    parent = regions.parent
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def adjacent_leaves(leaves: Leaves, shape: Ints) -> Ints:
    """Find the pairs of leaves that share a face, an edge or a corner.

    Parameters
    ----------
    leaves
        The leaves, which may extend beyond the grid.
    shape
        Size (3,) of the grid, in cells.

    Returns
    -------
    ndarray
        Indices (m, 2) of the leaves of each pair, the lower index first.
    """
    count, n = 0, leaves.counts[0]
    pairs = np.empty((16 * n + 64, 2), np.int64)
    least = leaves.side[:n].min() if n else 1
    grid = (shape - 1) // least + 1
    lows, highs = leaves.corner[:n] // least, (leaves.corner[:n].T + leaves.side[:n]).T // least
    highs = np.minimum(highs, grid)
    leaf_grid = _box_map(lows, highs, grid)
    marks = np.full(n, -1)
    for i in range(n):
        low, high = lows[i], highs[i]
        for x in range(max(low[0] - 1, 0), min(high[0] + 1, leaf_grid.shape[0])):
            for y in range(max(low[1] - 1, 0), min(high[1] + 1, leaf_grid.shape[1])):
                inside = low[0] <= x < high[0] and low[1] <= y < high[1]
                step = high[2] - low[2] + 1 if inside else 1  # skips the leaf's own cells
                for z in range(low[2] - 1, high[2] + 1, step):
                    if 0 <= z < leaf_grid.shape[2]:
                        j = leaf_grid[x, y, z] - 1
                        if j > i and marks[j] != i:
                            marks[j] = i
                            if count == len(pairs):
                                pairs = np.concatenate((pairs, np.empty_like(pairs)))
                            pairs[count, 0], pairs[count, 1] = i, j
                            count += 1
    return pairs[:count]


@compiled
def _box_map(lows: Ints, highs: Ints, shape: Ints) -> IndexGrid:
    leaf_grid = np.zeros((shape[0], shape[1], shape[2]), np.int32)
    for i in range(len(lows)):
        low, high = lows[i], highs[i]
        leaf_grid[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = i + 1
    return leaf_grid

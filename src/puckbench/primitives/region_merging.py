"""Region merging: leaves side by side are merged while one plane explains them well enough.

Pairs of least cost are merged first (a priority queue over a graph of adjacent regions).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.core.compiling import compiled, compiled_in_place, inlined
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import MOMENT_COUNT, distance_to_fit, fit_plane
from puckbench.primitives.octree_arrays import Ints, LeafMap, Leaves

_LOW = (1 << 32) - 1


class MergeLimits(NamedTuple):
    """How much the squared distance to the planes may grow when two regions become one.

    fixed: in all. per_weight: for each unit of weight of the smaller region. min_cosine: of the
    angle between the two planes.
    """

    fixed: float
    per_weight: float
    min_cosine: float


class _Regions(NamedTuple):
    """Regions, each under the index of one of its leaves (union-find).

    moments: (n, 10), planes: (n, 4), errors: (n,) of the regions. parent: (n,) the region that a
    leaf was merged into, itself at first. version: (n,) number of merges, -1 for part of another
    region. scratch: (10,) room for moments.
    """

    moments: Floats
    planes: Floats
    errors: Floats
    parent: Ints
    version: Ints
    scratch: Floats


class _Adjacency(NamedTuple):
    """Linked lists of the leaves beside each region.

    begin, end: (n,) ends of each list. other, next: (m,) its entries.
    """

    begin: Ints
    end: Ints
    other: Ints
    next: Ints


class _Queue(NamedTuple):
    """Pairs of regions that may be merged, as a binary heap: those of least cost are first.

    cost: (m,) of merging. pair: (m,) both regions. versions: (m,) of both when they were queued;
    two numbers in one, of 32 bits each. size: (1,) number of entries.
    """

    cost: Floats
    pair: Ints
    versions: Ints
    size: Ints


def region_moments(moments: Floats, leaves: Leaves, shape: Ints, limits: MergeLimits) -> Floats:
    """Moments (n, 10) of the region that each leaf is in; shape: (3,) cells of the grid."""
    region_of = merge_regions(moments, adjacent_leaves(leaves, shape), limits)
    sums = np.zeros_like(moments)
    np.add.at(sums, region_of, moments)
    return np.asarray(sums[region_of])


@compiled
def merge_regions(moments: Floats, pairs: Ints, limits: MergeLimits) -> Ints:
    """Merge adjacent pieces of surface to regions.

    Parameters
    ----------
    moments
        (n, 10) of the pieces.
    pairs
        (m, 2) indices of adjacent pieces, both with weight.
    limits
        How much the squared distance may grow.

    Returns
    -------
    ndarray
        (n,) the region of each piece: the index of one of its pieces.
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
    adjacency = _linked_lists(n, pairs)
    most = 2 * len(pairs) + 1  # those that are not outdated are half of these at most
    queue = _Queue(
        np.empty(most), np.empty(most, np.int64), np.empty(most, np.int64), np.zeros(1, np.int64)
    )
    for k in range(len(pairs)):
        _push_pair(queue, regions, limits, pairs[k, 0], pairs[k, 1])
    seen = np.full(n, -1)
    while queue.size[0]:
        is_current, a, b = _pop(queue, regions)
        if is_current:
            _merge(regions, adjacency, a, b)
            _push_neighbours(queue, regions, adjacency, limits, a, seen)
    for i in range(n):
        regions.parent[i] = _root(regions, i)
    return regions.parent


@compiled
def _linked_lists(n: int, pairs: Ints) -> _Adjacency:
    lists = np.full((2, n), -1)
    adjacency = _Adjacency(
        lists[0], lists[1], pairs[:, ::-1].copy().ravel(), np.full(pairs.size, -1)
    )
    for k in range(pairs.size):
        _append(adjacency, pairs[k // 2, k % 2], k, k)
    return adjacency


@inlined
def _append(adjacency: _Adjacency, a: int, begin: int, end: int) -> None:
    """Append a list, from `begin` to `end`, to a region's."""
    if adjacency.begin[a] < 0:
        adjacency.begin[a] = begin
    else:
        adjacency.next[adjacency.end[a]] = begin
    adjacency.end[a] = end


@inlined
def _merge(regions: _Regions, adjacency: _Adjacency, a: int, b: int) -> None:
    """Make region b part of a."""
    regions.parent[b] = a
    regions.version[b] = -1
    regions.version[a] += 1
    for k in range(MOMENT_COUNT):
        regions.moments[a, k] += regions.moments[b, k]
    regions.errors[a] = fit_plane(regions.moments[a], regions.planes[a])
    _append(adjacency, a, adjacency.begin[b], adjacency.end[b])


@compiled_in_place
def _push_neighbours(
    queue: _Queue,
    regions: _Regions,
    adjacency: _Adjacency,
    limits: MergeLimits,
    a: int,
    seen: Ints,
) -> None:
    """Queue a region with each of its neighbours, and remove duplicates from its list.

    seen: (n,) marks of the regions already queued; no two calls have the same mark.
    """
    mark = a * len(seen) + regions.version[a]
    edge, before = adjacency.begin[a], -1
    while edge >= 0:
        c = _root(regions, adjacency.other[edge])
        if c == a or seen[c] == mark:
            if before < 0:
                adjacency.begin[a] = adjacency.next[edge]
            else:
                adjacency.next[before] = adjacency.next[edge]
        else:
            seen[c] = mark
            _push_pair(queue, regions, limits, a, c)
            before = edge
        edge = adjacency.next[edge]
    adjacency.end[a] = before


@inlined
def _push_pair(
    queue: _Queue,
    regions: _Regions,
    limits: MergeLimits,
    a: int,
    b: int,
) -> None:
    """Queue two regions, if they may be merged."""
    if _cosine(regions.planes, a, b) < limits.min_cosine:
        return
    smaller = min(regions.moments[a, 0], regions.moments[b, 0])
    allowed = limits.fixed + limits.per_weight * smaller
    added = _error_of_both(regions, a, b) - (regions.errors[a] + regions.errors[b])
    if added <= allowed:
        _push(queue, regions, added / allowed, a, b)


@inlined
def _push(queue: _Queue, regions: _Regions, cost: float, a: int, b: int) -> None:
    """Queue two regions at their present versions."""
    if queue.size[0] == len(queue.cost):
        _drop_outdated(queue, regions)
    last = queue.size[0]
    queue.size[0] += 1
    versions = regions.version[a] << 32 | regions.version[b]
    _sift_up(queue, last, cost, a << 32 | b, versions)


@inlined
def _pop(queue: _Queue, regions: _Regions) -> tuple[bool, int, int]:
    """Take the first pair off the queue, and whether both are as they were when it was queued."""
    pair, is_current = queue.pair[0], _is_current(queue, regions, 0)
    queue.size[0] -= 1
    last, hole = queue.size[0], 0
    while 2 * hole + 1 < last:
        child = 2 * hole + 1
        if child + 1 < last and _is_before(
            queue, child + 1, queue.cost[child], queue.pair[child], queue.versions[child]
        ):
            child += 1
        _move(queue, child, hole)
        hole = child
    _sift_up(queue, hole, queue.cost[last], queue.pair[last], queue.versions[last])
    return is_current, pair >> 32, pair & _LOW


@inlined
def _sift_up(queue: _Queue, hole: int, cost: float, pair: int, versions: int) -> None:
    """Write an entry to a free place or above it, and move those down that come after it."""
    while hole > 0 and not _is_before(queue, (hole - 1) // 2, cost, pair, versions):
        _move(queue, (hole - 1) // 2, hole)
        hole = (hole - 1) // 2
    queue.cost[hole], queue.pair[hole], queue.versions[hole] = cost, pair, versions


@inlined
def _is_before(queue: _Queue, at: int, cost: float, pair: int, versions: int) -> bool:
    """Whether an entry of the queue comes before another one."""
    if queue.cost[at] != cost:
        return bool(queue.cost[at] < cost)
    if queue.pair[at] != pair:
        return bool(queue.pair[at] < pair)
    return bool(queue.versions[at] < versions)


@inlined
def _move(queue: _Queue, start: int, end: int) -> None:
    queue.cost[end], queue.pair[end] = queue.cost[start], queue.pair[start]
    queue.versions[end] = queue.versions[start]


@inlined
def _is_current(queue: _Queue, regions: _Regions, at: int) -> bool:
    """Whether the regions of an entry are as they were when it was queued."""
    a, b = queue.pair[at] >> 32, queue.pair[at] & _LOW
    return bool(queue.versions[at] == regions.version[a] << 32 | regions.version[b])


@compiled_in_place
def _drop_outdated(queue: _Queue, regions: _Regions) -> None:
    """Remove the entries of regions that have been merged since."""
    size, queue.size[0] = queue.size[0], 0
    for at in range(size):
        if _is_current(queue, regions, at):
            last = queue.size[0]
            queue.size[0] += 1
            _sift_up(queue, last, queue.cost[at], queue.pair[at], queue.versions[at])


@inlined
def _cosine(planes: Floats, a: int, b: int) -> float:
    """Cosine of the angle between two planes."""
    along = planes[a, 0] * planes[b, 0] + planes[a, 1] * planes[b, 1]
    return float(abs(along + planes[a, 2] * planes[b, 2]))


@inlined
def _error_of_both(regions: _Regions, a: int, b: int) -> float:
    """Squared distance to the common plane of two regions."""
    moments = regions.scratch
    for k in range(MOMENT_COUNT):
        moments[k] = regions.moments[a, k] + regions.moments[b, k]
    return distance_to_fit(moments)


@inlined
def _root(regions: _Regions, i: int) -> int:
    """The region that a piece is in."""
    parent = regions.parent
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def adjacent_leaves(leaves: Leaves, shape: Ints) -> Ints:
    """Pairs of leaves that have a face, an edge or a corner in common.

    Parameters
    ----------
    leaves
        Their corners are multiples of their sides, which are powers of two.
    shape
        (3,) cells of the grid, outside of which nothing is adjacent.

    Returns
    -------
    ndarray
        (m, 2) indices, the lower one first.
    """
    count, n = 0, leaves.counts[0]
    pairs = np.empty((16 * n + 64, 2), np.int64)
    least = leaves.side[:n].min() if n else 1
    grid = (shape - 1) // least + 1
    lows, highs = leaves.corner[:n] // least, (leaves.corner[:n].T + leaves.side[:n]).T // least
    highs = np.minimum(highs, grid)
    leaf_map = _box_map(lows, highs, grid)
    seen = np.full(n, -1)
    for i in range(n):
        low, high = lows[i], highs[i]
        for x in range(max(low[0] - 1, 0), min(high[0] + 1, leaf_map.shape[0])):
            for y in range(max(low[1] - 1, 0), min(high[1] + 1, leaf_map.shape[1])):
                inside = low[0] <= x < high[0] and low[1] <= y < high[1]
                step = high[2] - low[2] + 1 if inside else 1  # from below the leaf to above it
                for z in range(low[2] - 1, high[2] + 1, step):
                    if 0 <= z < leaf_map.shape[2]:
                        j = leaf_map[x, y, z] - 1
                        if j > i and seen[j] != i:
                            seen[j] = i
                            if count == len(pairs):
                                pairs = np.concatenate((pairs, np.empty_like(pairs)))
                            pairs[count, 0], pairs[count, 1] = i, j
                            count += 1
    return pairs[:count]


@compiled
def _box_map(lows: Ints, highs: Ints, shape: Ints) -> LeafMap:
    """Grid of the index + 1 of the box, from lows (n, 3) to highs (n, 3), that has a cell."""
    leaf_map = np.zeros((shape[0], shape[1], shape[2]), np.int32)
    for i in range(len(lows)):
        low, high = lows[i], highs[i]
        leaf_map[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = i + 1
    return leaf_map

"""Regions: pieces of surface, side by side, that one plane is near enough to."""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np

from puckbench.codecs.primitives.layout import Ints, Leaves, Owners
from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import fit_plane


class Limits(NamedTuple):
    """How much the squared distances to its plane may grow for two regions to become one.

    fixed: in all. share: for each weight of the smaller region. cosine: of the angle between the
    two planes, which may be no less.
    """

    fixed: float
    share: float
    cosine: float


class _Regions(NamedTuple):
    """Regions under their first pieces' numbers: moments (n, 10), planes (n, 4), errors (n,).

    first: (n,) the number of the region that a piece went into, its own at first. changes: (n,) how
    often a region has changed, -1 when it is part of another.
    """

    moments: Floats
    planes: Floats
    errors: Floats
    first: Ints
    changes: Ints


class _Borders(NamedTuple):
    """Lists of the pieces beside each region: begin and end (n,), then other and next (m,)."""

    begin: Ints
    end: Ints
    other: Ints
    next: Ints


def wholes(moments: Floats, leaves: Leaves, shape: Ints, limits: Limits) -> Floats:
    """Moments (n, 10) of the region that each leaf is in, of the leaves' own.

    shape: (3,) cells of the grid.
    """
    region = joined(moments, touching(leaves, shape), limits)
    sums = np.zeros_like(moments)
    np.add.at(sums, region, moments)
    return np.asarray(sums[region])


@compiled
def joined(moments: Floats, pairs: Ints, limits: Limits) -> Ints:
    """The region (n,) of each piece: the number of one of its pieces.

    moments: (n, 10) of the pieces. pairs: (m, 2) of those side by side, both with weight. What is
    joined first is what adds least to the squared distances, of what it may add.
    """
    n = len(moments)
    regions = _Regions(
        moments.copy(), np.zeros((n, 4)), np.zeros(n), np.arange(n), np.zeros(n, np.int64)
    )
    for i in range(n):
        if moments[i, 0] > 0:
            regions.errors[i] = fit_plane(moments[i], regions.planes[i])
    borders = _borders(n, pairs)
    waiting = [(0.0, 0, 0, 0, 0)]
    waiting.pop()
    for k in range(len(pairs)):
        _offer(waiting, regions, limits, pairs[k, 0], pairs[k, 1])
    seen = np.full(n, -1)
    while waiting:
        _, a, b, of_a, of_b = heapq.heappop(waiting)
        if regions.changes[a] == of_a and regions.changes[b] == of_b:
            _join(regions, borders, a, b)
            _offer_all(waiting, regions, borders, limits, a, seen)
    for i in range(n):
        regions.first[i] = _region(regions, i)
    return regions.first


@compiled
def _borders(n: int, pairs: Ints) -> _Borders:
    lists = np.full((2, n), -1)
    borders = _Borders(lists[0], lists[1], pairs[:, ::-1].copy().ravel(), np.full(pairs.size, -1))
    for k in range(pairs.size):
        _append(borders, pairs[k // 2, k % 2], k, k)
    return borders


@compiled
def _append(borders: _Borders, a: int, begin: int, end: int) -> None:
    """Put a list, from `begin` to `end`, at the end of a region's."""
    if borders.begin[a] < 0:
        borders.begin[a] = begin
    else:
        borders.next[borders.end[a]] = begin
    borders.end[a] = end


@compiled
def _join(regions: _Regions, borders: _Borders, a: int, b: int) -> None:
    """Make region b part of a."""
    regions.first[b] = a
    regions.changes[b] = -1
    regions.changes[a] += 1
    regions.moments[a] += regions.moments[b]
    regions.errors[a] = fit_plane(regions.moments[a], regions.planes[a])
    _append(borders, a, borders.begin[b], borders.end[b])


@compiled
def _offer_all(
    waiting: list[tuple[float, int, int, int, int]],
    regions: _Regions,
    borders: _Borders,
    limits: Limits,
    a: int,
    seen: Ints,
) -> None:
    """Offer a region to those beside it, and leave out of its list what is in it twice.

    seen: (n,) for marks; no two calls make the same.
    """
    mark = a * len(seen) + regions.changes[a]
    edge, before = borders.begin[a], -1
    while edge >= 0:
        c = _region(regions, borders.other[edge])
        if c == a or seen[c] == mark:
            if before < 0:
                borders.begin[a] = borders.next[edge]
            else:
                borders.next[before] = borders.next[edge]
        else:
            seen[c] = mark
            _offer(waiting, regions, limits, a, c)
            before = edge
        edge = borders.next[edge]
    borders.end[a] = before


@compiled
def _offer(
    waiting: list[tuple[float, int, int, int, int]],
    regions: _Regions,
    limits: Limits,
    a: int,
    b: int,
) -> None:
    """Let two regions wait to be joined, if they may be."""
    p, q = regions.planes[a], regions.planes[b]
    if abs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2]) < limits.cosine:
        return
    lesser = min(regions.moments[a, 0], regions.moments[b, 0])
    allowed = limits.fixed + limits.share * lesser
    plane = np.empty(4)
    added = fit_plane(regions.moments[a] + regions.moments[b], plane)
    added -= regions.errors[a] + regions.errors[b]
    if added <= allowed:
        changes = regions.changes
        heapq.heappush(waiting, (added / allowed, a, b, changes[a], changes[b]))


@compiled
def _region(regions: _Regions, i: int) -> int:
    """The region that a piece is in."""
    first = regions.first
    while first[i] != i:
        first[i] = first[first[i]]
        i = first[i]
    return i


@compiled
def touching(leaves: Leaves, shape: Ints) -> Ints:
    """Pairs (m, 2) of leaves, the first before the second, that have a face, edge or corner common.

    Corners are multiples of the leaves' sides, which are powers of two. shape: (3,) cells of the
    grid, past which nothing touches.
    """
    count, n = 0, leaves.counts[0]
    pairs = np.empty((16 * n + 64, 2), np.int64)
    least = leaves.side[:n].min() if n else 1
    grid = (shape - 1) // least + 1
    lows, highs = leaves.corner[:n] // least, (leaves.corner[:n].T + leaves.side[:n]).T // least
    highs = np.minimum(highs, grid)
    owner = _owners(lows, highs, grid)
    seen = np.full(n, -1)
    for i in range(n):
        low, high = lows[i], highs[i]
        for x in range(max(low[0] - 1, 0), min(high[0] + 1, owner.shape[0])):
            for y in range(max(low[1] - 1, 0), min(high[1] + 1, owner.shape[1])):
                inside = low[0] <= x < high[0] and low[1] <= y < high[1]
                step = high[2] - low[2] + 1 if inside else 1  # from below the leaf to above it
                for z in range(low[2] - 1, high[2] + 1, step):
                    if 0 <= z < owner.shape[2]:
                        j = owner[x, y, z] - 1
                        if j > i and seen[j] != i:
                            seen[j] = i
                            if count == len(pairs):
                                pairs = np.concatenate((pairs, np.empty_like(pairs)))
                            pairs[count, 0], pairs[count, 1] = i, j
                            count += 1
    return pairs[:count]


@compiled
def _owners(lows: Ints, highs: Ints, shape: Ints) -> Owners:
    """A grid of which box (n, 3), from its least corner to its greatest, has a cell, and 1."""
    owner = np.zeros((shape[0], shape[1], shape[2]), np.int32)
    for i in range(len(lows)):
        low, high = lows[i], highs[i]
        owner[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = i + 1
    return owner

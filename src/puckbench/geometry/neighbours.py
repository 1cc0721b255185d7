"""Nearest neighbours with all their ties, by MPEG's rule for points at the same distance.

Decoded clouds lie on grids, where a fifth to a third of the queries have several nearest
neighbours; a measure that picks one of them depends on the library and on the order of the points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pykdtree.kdtree import KDTree

from puckbench.core.compiling import compiled
from puckbench.geometry.box_search import SAME_DISTANCE, NearestTwo, nearest_two
from puckbench.geometry.box_tree import box_tree
from puckbench.geometry.cloud import Floats

Rows = NDArray[np.int64]
Indices = NDArray[np.uint32]

LOOKED_AT_FIRST, LOOKED_AT_MORE, LOOKED_AT_MOST = 10, 5, 30
"""Numbers of neighbours that pc_error searches: more while all of them are equally near."""
LEAF_SIZE = 16


@dataclass(frozen=True)
class Neighbours:
    """Nearest neighbours of m queries, ties included.

    Parameters
    ----------
    squared
        Squared distance to the nearest, (m,).
    starts
        (m + 1,): the neighbours of query i are ``index[starts[i]:starts[i + 1]]``, nearest first.
    exact
        (m,): number of neighbours at exactly the nearest distance; the others are within
        SAME_DISTANCE of the one before.
    index
        Rows of the points that were searched.
    """

    squared: Floats
    starts: Rows
    exact: Rows
    index: Rows


@dataclass(frozen=True)
class _Group:
    """Queries (rows) with equally many sorted neighbours, of which `counts` and `exact` tie."""

    rows: Rows
    index: Indices
    counts: Rows
    exact: Rows


class SearchablePoints:
    """Distinct points (n, 3) float64, made ready for searches among them and from them."""

    def __init__(self, points: Floats) -> None:
        self._points = points
        self._boxes = box_tree(points)

    @cached_property
    def _tree(self) -> Any:
        """A tree that finds many neighbours, in an order of its own where they tie."""
        return KDTree(self._points, leafsize=LEAF_SIZE)

    def nearest(self, queries: SearchablePoints) -> Neighbours:
        """Nearest neighbours of the queries with all ties.

        The nearest two are searched first; queries of which three or more tie, few but on grids,
        are searched again, with more neighbours while all of those tie.
        """
        found = nearest_two(queries._boxes, self._boxes)
        rows, groups = np.flatnonzero(found.ties > 2), []
        for k in _growing_numbers():
            if not len(rows):
                break
            index, squared = self._sorted_neighbours(queries._points[rows], k)
            counts, exact = _count_ties(squared)
            tied = counts == k if k < LOOKED_AT_FIRST else exact == k
            done = ~tied | (k >= len(self._points))
            groups.append(_Group(rows[done], index[done], counts[done], exact[done]))
            rows = rows[~done]
        return _join(found, groups)

    def _sorted_neighbours(self, queries: Floats, k: int) -> tuple[Indices, Floats]:
        """Indices and squared distances, (m, min(k, n)), sorted by our own float64 distances."""
        k = min(k, len(self._points))
        _, index = self._tree.query(queries, k=k, sqr_dists=True)
        index = index.reshape(len(queries), k)
        return index, _sort_by_distance(queries, self._points, index)


def _growing_numbers() -> Iterator[int]:
    yield from (5, LOOKED_AT_FIRST)
    yield from (LOOKED_AT_MOST * 4**power for power in count())


@compiled
def _sort_by_distance(queries: Floats, points: Floats, index: Indices) -> Floats:
    """Squared distances of the neighbours; sorts them and, in place, `index`."""
    squared = np.empty(index.shape, np.float64)
    for i in range(len(index)):
        for j in range(index.shape[1]):
            candidate = index[i, j]
            dx = queries[i, 0] - points[candidate, 0]
            dy = queries[i, 1] - points[candidate, 1]
            dz = queries[i, 2] - points[candidate, 2]
            distance = dx * dx + dy * dy + dz * dz
            place = j
            while place > 0 and squared[i, place - 1] > distance:
                squared[i, place], index[i, place] = squared[i, place - 1], index[i, place - 1]
                place -= 1
            squared[i, place], index[i, place] = distance, candidate
    return squared


@compiled
def _count_ties(squared: Floats) -> tuple[Rows, Rows]:
    """Numbers of sorted neighbours that count as nearest, and that are exactly nearest."""
    m, k = squared.shape
    counts, exact = np.ones(m, np.int64), np.ones(m, np.int64)
    for i in range(m):
        while exact[i] < k and squared[i, exact[i]] == squared[i, 0]:
            exact[i] += 1
        looked_at = LOOKED_AT_FIRST
        while exact[i] >= looked_at and looked_at < LOOKED_AT_MOST:
            looked_at += LOOKED_AT_MORE
        counts[i] = exact[i]
        for j in range(exact[i], min(looked_at, k)):
            if squared[i, j] - squared[i, j - 1] >= SAME_DISTANCE:
                break
            counts[i] += 1
    return counts, exact


def _join(found: NearestTwo, groups: list[_Group]) -> Neighbours:
    """Concatenate the neighbours in the order of the queries; `groups` have more than two."""
    counts, exact = found.ties, found.exact
    for group in groups:
        counts[group.rows], exact[group.rows] = group.counts, group.exact
    starts = np.concatenate([[0], np.cumsum(counts)])
    index = _first_two(found.rows, starts)
    for group in groups:
        _fill(index, starts, group.rows, group.index, group.counts)
    return Neighbours(found.squared, starts, exact, index)


@compiled
def _first_two(rows: Rows, starts: Rows) -> Rows:
    index = np.empty(starts[-1], np.int64)
    for i in range(len(rows)):
        for j in range(min(2, starts[i + 1] - starts[i])):
            index[starts[i] + j] = rows[i, j]
    return index


@compiled
def _fill(target: Rows, starts: Rows, rows: Rows, index: Indices, counts: Rows) -> None:
    for i in range(len(rows)):
        for j in range(counts[i]):
            target[starts[rows[i]] + j] = index[i, j]

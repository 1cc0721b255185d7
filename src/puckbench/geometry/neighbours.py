"""Nearest neighbours of points, with all ties, as MPEG's program pc_error defines them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pykdtree.kdtree import KDTree

from pointkit.compiling import compiled
from pointkit.geometry.box_tree import box_tree
from pointkit.geometry.cloud import Floats
from puckbench.geometry.box_search import SAME_DISTANCE, nearest_two

Rows = NDArray[np.int64]
Indices = NDArray[np.uint32]

FIRST_K, K_STEP, MAX_K = 10, 5, 30
"""Numbers of neighbours that pc_error searches.

It first searches `FIRST_K` neighbours. While all of these tie, it adds `K_STEP`, up to `MAX_K`.
"""
LEAF_SIZE = 16


@dataclass(frozen=True)
class Neighbours:
    """The nearest neighbours of m queries, with all neighbours that tie.

    Parameters
    ----------
    squared
        Smallest squared distance of each query, (m,).
    starts
        The neighbours of query i are the points ``index[starts[i]:starts[i + 1]]``, nearest first;
        (m + 1,).
    exact
        Number of neighbours at exactly the smallest distance, (m,). They are the first ones of a
        query.
    index
        Indices of the neighbours of all queries, one query after another.
    """

    squared: Floats
    starts: Rows
    exact: Rows
    index: Rows


class SearchablePoints:
    """Points (n, 3) prepared for finding their points nearest to other points."""

    def __init__(self, points: Floats) -> None:
        self._points = points
        self._boxes = box_tree(points)

    @cached_property
    def _tree(self) -> Any:
        return KDTree(self._points, leafsize=LEAF_SIZE)

    def nearest(self, queries: SearchablePoints) -> Neighbours:
        """Return the nearest of these points to each query, with all ties."""
        two = nearest_two(queries._boxes, self._boxes)
        counts, exact = two.ties, two.exact
        rows, groups = np.flatnonzero(counts > 2), []
        for k in _neighbour_counts():
            if not len(rows):
                break
            index, squared = self._sorted_neighbours(queries._points[rows], k)
            tied, equal = _count_ties(squared)
            is_unfinished = tied == k if k < FIRST_K else equal == k
            done = ~is_unfinished | (k >= len(self._points))
            counts[rows[done]], exact[rows[done]] = tied[done], equal[done]
            groups.append((rows[done], index[done]))
            rows = rows[~done]
        starts = np.append(0, np.cumsum(counts))
        rows_of_ties = np.empty(starts[-1], np.int64)
        has_second = counts > 1
        rows_of_ties[starts[:-1]] = two.rows[:, 0]
        rows_of_ties[starts[:-1][has_second] + 1] = two.rows[has_second, 1]
        for group, neighbours in groups:
            places = np.arange(neighbours.shape[1])
            is_tied = places < counts[group, None]
            rows_of_ties[(starts[group, None] + places)[is_tied]] = neighbours[is_tied]
        return Neighbours(two.squared, starts, exact, rows_of_ties)

    def _sorted_neighbours(self, queries: Floats, k: int) -> tuple[Indices, Floats]:
        k = min(k, len(self._points))
        _, index = self._tree.query(queries, k=k, sqr_dists=True)
        index = index.reshape(len(queries), k)
        return index, _sort_by_distance(queries, self._points, index)


def _neighbour_counts() -> Iterator[int]:
    yield from (5, FIRST_K)
    yield from (MAX_K * 4**power for power in count())


@compiled
def _sort_by_distance(queries: Floats, points: Floats, index: Indices) -> Floats:
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
    """Return how many neighbours of each query tie by pc_error's rule, and how many tie exactly."""
    m, k = squared.shape
    counts, exact = np.ones(m, np.int64), np.ones(m, np.int64)
    for i in range(m):
        while exact[i] < k and squared[i, exact[i]] == squared[i, 0]:
            exact[i] += 1
        searched = FIRST_K
        while exact[i] >= searched and searched < MAX_K:
            searched += K_STEP
        counts[i] = exact[i]
        for j in range(exact[i], min(searched, k)):
            if squared[i, j] - squared[i, j - 1] >= SAME_DISTANCE:
                break
            counts[i] += 1
    return counts, exact

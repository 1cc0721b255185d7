"""Exact search for the two points nearest to each query, with two trees of bounding boxes.

One tree holds the queries, the other holds the points. All queries in a leaf of the first tree
(about twenty) are searched in the second tree together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled, inlined
from pointkit.geometry.box_tree import BoxTree, push
from pointkit.geometry.cloud import Floats
from pointkit.geometry.spatial_order import Rows
from pointkit.threads import in_threads

SAME_DISTANCE = 1e-8
"""Two squared distances count as equal if they differ by less than this value, which is
similarPointThreshold in MPEG's pc_error.
"""
MARGIN = 4 * SAME_DISTANCE
"""Excess over the smallest squared distance up to which points are kept: two ties and rounding."""
LEAVES_AT_ONCE = 1024


class NearestTwo(NamedTuple):
    """The nearest points of m queries, as `nearest_two` returns them.

    Two points tie if their squared distances, sorted, differ by less than `SAME_DISTANCE`.

    Parameters
    ----------
    squared
        Squared distances of the queries to their nearest points, (m,).
    rows
        Indices of the two nearest points if these tie, or twice the index of the nearest point,
        (m, 2).
    ties
        Numbers of points that tie for the nearest, (m,): 1 is no tie, and 3 stands for three or
        more.
    exact
        Numbers of points at exactly the smallest distance, (m,), 1 or 2.
    """

    squared: Floats
    rows: Rows
    ties: Rows
    exact: Rows


class _Block(NamedTuple):
    limits: Floats
    squared: Floats
    places: Rows


def nearest_two(queries: BoxTree, points: BoxTree) -> NearestTwo:
    """Search the two nearest points of each query.

    Parameters
    ----------
    queries, points
        Trees of bounding boxes over the m queries and over the points to be searched.

    Returns
    -------
    NearestTwo
        Arrays with one row for each query, in the original order of the queries.
    """
    m = len(queries.rows)
    nearest = NearestTwo(np.empty(m), *(np.empty(shape, np.int64) for shape in ((m, 2), m, m)))
    parts = range(0, len(queries.leaves), LEAVES_AT_ONCE)
    in_threads(lambda i: _search(queries, i, i + LEAVES_AT_ONCE, points, nearest), parts)
    return nearest


@compiled
def _search(queries: BoxTree, start: int, end: int, points: BoxTree, nearest: NearestTwo) -> None:
    q = queries.largest
    block = _Block(np.empty(q), np.empty((q, 3)), np.zeros((q, 2), np.int64))
    capacity, distances = 8 * points.depth, np.empty(points.largest)
    nodes, gaps = np.zeros(capacity, np.int64), np.zeros(capacity)
    for leaf in queries.leaves[start:end]:
        bound = _start_block(queries, leaf, points, block)
        size = 1  # the stack holds the root
        while size > 0:
            size -= 1
            node = nodes[size]
            if gaps[size] > bound:
                continue
            if points.children[node] == 0:
                bound = _compare_leaves(queries, leaf, points, node, block, distances)
            box, base = queries.boxes[leaf], size
            for child in range(points.first[node], points.first[node] + points.children[node]):
                other = points.boxes[child]
                dx = max(0.0, other[0] - box[3], box[0] - other[3])
                dy = max(0.0, other[1] - box[4], box[1] - other[4])
                dz = max(0.0, other[2] - box[5], box[2] - other[5])
                gap = dx * dx + dy * dy + dz * dz
                if gap <= bound:
                    push(nodes, gaps, base, size, child, gap)
                    size += 1
        nodes[0], gaps[0] = 0, 0.0
        _write_result(queries, leaf, points, block, nearest)


@inlined
def _start_block(queries: BoxTree, leaf: int, points: BoxTree, block: _Block) -> float:
    x, y, z = queries.columns
    place, bound = block.places[0, 0], 0.0
    for i in range(queries.ends[leaf] - queries.starts[leaf]):
        query = queries.starts[leaf] + i
        dx = x[query] - points.columns[0, place]
        dy = y[query] - points.columns[1, place]
        dz = z[query] - points.columns[2, place]
        block.limits[i] = dx * dx + dy * dy + dz * dz + MARGIN
        bound = max(bound, block.limits[i])
        block.squared[i] = np.inf
        block.places[i] = place
    return bound


@inlined
def _compare_leaves(
    queries: BoxTree, leaf: int, points: BoxTree, node: int, block: _Block, distances: Floats
) -> float:
    box, bound = points.boxes[node], 0.0
    x = points.columns[0, points.starts[node] : points.ends[node]]
    y = points.columns[1, points.starts[node] : points.ends[node]]
    z = points.columns[2, points.starts[node] : points.ends[node]]
    for i in range(queries.ends[leaf] - queries.starts[leaf]):
        query = queries.starts[leaf] + i
        qx, qy, qz = queries.columns[0, query], queries.columns[1, query], queries.columns[2, query]
        limit = block.limits[i]
        dx = max(0.0, box[0] - qx, qx - box[3])
        dy = max(0.0, box[1] - qy, qy - box[4])
        dz = max(0.0, box[2] - qz, qz - box[5])
        if dx * dx + dy * dy + dz * dz <= limit:
            for j in range(len(x)):
                dx, dy, dz = qx - x[j], qy - y[j], qz - z[j]
                distances[j] = dx * dx + dy * dy + dz * dz
            for j in range(len(x)):
                if distances[j] <= limit:
                    limit = _insert(block, i, distances[j], points.starts[node] + j)
        bound = max(bound, limit)
    return bound


@inlined
def _insert(block: _Block, i: int, distance: float, place: int) -> float:
    squared, places = block.squared[i], block.places[i]
    if distance < squared[0]:
        squared[0], squared[1], squared[2] = distance, squared[0], squared[1]
        places[0], places[1] = place, places[0]
        block.limits[i] = min(block.limits[i], distance + MARGIN)
    elif distance < squared[1]:
        squared[1], squared[2] = distance, squared[1]
        places[1] = place
    elif distance < squared[2]:
        squared[2] = distance
    return float(block.limits[i])


@inlined
def _write_result(
    queries: BoxTree, leaf: int, points: BoxTree, block: _Block, nearest: NearestTwo
) -> None:
    for i in range(queries.ends[leaf] - queries.starts[leaf]):
        row, squared = queries.rows[queries.starts[leaf] + i], block.squared[i]
        first, second = points.rows[block.places[i, 0]], points.rows[block.places[i, 1]]
        exact, ties = 1, 1
        if squared[1] - squared[0] < SAME_DISTANCE:
            ties = 3 if squared[2] - squared[1] < SAME_DISTANCE else 2
            exact = 2 if squared[1] == squared[0] else 1
        else:
            second = first
        if exact == 2:
            first, second = min(first, second), max(first, second)
        nearest.squared[row], nearest.ties[row], nearest.exact[row] = squared[0], ties, exact
        nearest.rows[row, 0], nearest.rows[row, 1] = first, second

"""Nearest-neighbour search that gives up after a maximum number of visited points and boxes.

The maximum bounds the time of a decoder: a query at the centre of a sphere would otherwise visit
all points of the sphere.
"""

from __future__ import annotations

import numpy as np

from pointkit.compiling import compiled, inlined
from pointkit.geometry.box_tree import BoxTree, push
from pointkit.geometry.cloud import Floats
from pointkit.geometry.spatial_order import Rows


def nearest_within(queries: Floats, points: BoxTree, max_visits: int) -> tuple[Floats, Rows] | None:
    """Find the point nearest to each query.

    Parameters
    ----------
    queries
        Coordinates (m, 3).
    points
        The points to search, in a tree of boxes.
    max_visits
        Largest total number of points and boxes that all queries may visit.

    Returns
    -------
    tuple of ndarray, or None
        Distances (m,) and indices (m,) of the nearest points; None if the search exceeds
        `max_visits`.
    """
    squared, places = np.empty(len(queries)), np.empty(len(queries), np.int64)
    if _search(queries, points, max_visits, squared, places) > max_visits:
        return None
    return np.sqrt(squared), points.rows[places]


@compiled
def _search(
    queries: Floats, points: BoxTree, max_visits: int, squared: Floats, places: Rows
) -> int:
    nodes, gaps = np.zeros(8 * points.depth, np.int64), np.zeros(8 * points.depth)
    nearest, visits = 0, 0
    for i, query in enumerate(queries):
        place = points.columns[:, nearest]
        bound = _squared_gap(query, place, place)
        nodes[0], gaps[0], size = 0, 0.0, 1
        while size > 0 and visits <= max_visits:
            size -= 1
            node = nodes[size]
            if gaps[size] > bound:
                continue
            start, end = points.starts[node], points.ends[node]
            if points.children[node] == 0:
                visits += end - start
                for j in range(start, end):
                    place = points.columns[:, j]
                    distance = _squared_gap(query, place, place)
                    if distance < bound:
                        bound, nearest = distance, j
            visits, base = visits + points.children[node], size
            for child in range(points.first[node], points.first[node] + points.children[node]):
                gap = _squared_gap(query, points.boxes[child, :3], points.boxes[child, 3:])
                if gap <= bound:
                    push(nodes, gaps, base, size, child, gap)
                    size += 1
        squared[i], places[i] = bound, nearest
    return visits


@inlined
def _squared_gap(query: Floats, low: Floats, high: Floats) -> float:
    dx = max(0.0, low[0] - query[0], query[0] - high[0])
    dy = max(0.0, low[1] - query[1], query[1] - high[1])
    dz = max(0.0, low[2] - query[2], query[2] - high[2])
    return float(dx * dx + dy * dy + dz * dz)

"""The nearest point of each query, by a search that gives up after so much work.

Where all points are about as far from a query, as on a sphere from its centre, every search tree
looks at all of them. A codec whose streams say where both lie has to bound that.
"""

from __future__ import annotations

import numpy as np

from puckbench.core.compiling import compiled, inlined
from puckbench.geometry.box_tree import BoxTree
from puckbench.geometry.cloud import Floats
from puckbench.geometry.spatial_order import Rows


def nearest_within(queries: Floats, points: BoxTree, most: int) -> tuple[Floats, Rows] | None:
    """Distance (m,) of each query's nearest point, and its row (m,) among the points.

    Parameters
    ----------
    queries
        (m, 3), those that stand together one after the other.
    points
        The tree of n > 0 points.
    most
        Points and boxes that all queries together may be compared with, at most.

    Returns
    -------
    tuple or None
        None where that is not enough.
    """
    squared, places = np.empty(len(queries)), np.empty(len(queries), np.int64)
    if _search(queries, points, most, squared, places) > most:
        return None
    return np.sqrt(squared), points.rows[places]


@compiled
def _search(queries: Floats, points: BoxTree, most: int, squared: Floats, places: Rows) -> int:
    """Fill in the nearest of each query; what was looked at, soon after `most` not further."""
    nodes, gaps = np.zeros(8 * points.depth, np.int64), np.zeros(8 * points.depth)
    nearest, looked = 0, 0
    for i, query in enumerate(queries):
        place = points.columns[:, nearest]
        bound = _squared(query, place, place)
        nodes[0], gaps[0], size = 0, 0.0, 1
        while size > 0 and looked <= most:
            size -= 1
            node = nodes[size]
            if gaps[size] > bound:
                continue
            start, end = points.starts[node], points.ends[node]
            if points.children[node] == 0:
                looked += end - start
                for j in range(start, end):
                    place = points.columns[:, j]
                    distance = _squared(query, place, place)
                    if distance < bound:
                        bound, nearest = distance, j
            looked, ground = looked + points.children[node], size
            for child in range(points.first[node], points.first[node] + points.children[node]):
                gap = _squared(query, points.boxes[child, :3], points.boxes[child, 3:])
                if gap <= bound:
                    _put(nodes, gaps, ground, size, child, gap)
                    size += 1
        squared[i], places[i] = bound, nearest
    return looked


@inlined
def _squared(query: Floats, low: Floats, high: Floats) -> float:
    """Squared distance of a point from a box, which may be a point."""
    dx = max(0.0, low[0] - query[0], query[0] - high[0])
    dy = max(0.0, low[1] - query[1], query[1] - high[1])
    dz = max(0.0, low[2] - query[2], query[2] - high[2])
    return float(dx * dx + dy * dy + dz * dz)


@inlined
def _put(nodes: Rows, gaps: Floats, ground: int, size: int, node: int, gap: float) -> None:
    """Put a node among its siblings on the stack, which begin at `ground`, the nearest on top."""
    place = size
    while place > ground and gaps[place - 1] < gap:
        gaps[place], nodes[place] = gaps[place - 1], nodes[place - 1]
        place -= 1
    gaps[place], nodes[place] = gap, node

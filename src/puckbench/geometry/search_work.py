"""How many points a search for the nearest looks at, which a codec bounds before it searches.

Where all points are about as far from a query, as on a sphere from its centre, every search tree
looks at all of them.
"""

from __future__ import annotations

import numpy as np

from puckbench.core.compiling import compiled, inlined
from puckbench.geometry.box_tree import BoxTree, box_tree
from puckbench.geometry.cloud import Floats
from puckbench.geometry.spatial_order import Rows, distinct_rows


def is_short_search(queries: Floats, points: Floats, most: int) -> bool:
    """Whether the search of the nearest point of each query looks at no more than `most` in all.

    Parameters
    ----------
    queries
        (m, 3), those that stand together one after the other.
    points
        (n, 3) finite coordinates, n > 0.
    most
        Points of all searches together, at most.
    """
    if len(queries) * len(points) <= most:
        return True
    tree = box_tree(points[distinct_rows(points)])
    return _looked_at(queries, tree, most) <= most


@compiled
def _looked_at(queries: Floats, points: BoxTree, most: int) -> int:
    """The points and boxes that the queries are compared with; it ends soon after `most`."""
    nodes, gaps = np.zeros(8 * points.depth, np.int64), np.zeros(8 * points.depth)
    nearest, looked = 0, 0
    for query in queries:
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
                    squared = _squared(query, place, place)
                    if squared < bound:
                        bound, nearest = squared, j
            looked, ground = looked + points.children[node], size
            for child in range(points.first[node], points.first[node] + points.children[node]):
                gap = _squared(query, points.boxes[child, :3], points.boxes[child, 3:])
                if gap <= bound:
                    _put(nodes, gaps, ground, size, child, gap)
                    size += 1
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

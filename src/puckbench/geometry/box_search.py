"""The nearest two of many points to each of many queries, whose trees of boxes are compared.

Queries that stand together are searched together: a box of some twenty queries goes down the tree
of the points, so that each of them hardly looks at more than the points of two leaves. Floating
point keeps the order of distances between boxes and points, so that the result is exact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.core.compiling import compiled, inlined
from puckbench.core.threads import in_threads
from puckbench.geometry.box_tree import BoxTree
from puckbench.geometry.cloud import Floats
from puckbench.geometry.spatial_order import Rows

SAME_DISTANCE = 1e-8
"""pc_error's similarPointThreshold: squared distances closer than this are one distance."""
MARGIN = 4 * SAME_DISTANCE
"""Squared distances up to this above the least are kept: two more steps that are one distance."""
LEAVES_AT_ONCE = 1024


class Nearest(NamedTuple):
    """The nearest points of each query (m,).

    Parameters
    ----------
    squared
        Squared distance to the nearest, (m,).
    rows
        The nearest two where two tie, (m, 2), at the same distance the lower row first; without a
        tie the nearest twice. Which two of three or more is not defined.
    ties
        Number of points that tie: 1, 2, or 3 for three and more.
    exact
        Of the nearest two, how many are at exactly the nearest distance.
    """

    squared: Floats
    rows: Rows
    ties: Rows
    exact: Rows


class _Block(NamedTuple):
    """State of the queries of a leaf that are searched together, (q,) each.

    ``limits``: farther points are not looked at; ``squared`` (q, 3) and ``places`` (q, 2): the
    least distances found and where those points stand in their tree.
    """

    limits: Floats
    squared: Floats
    places: Rows


class _Stack(NamedTuple):
    """Nodes that wait to be looked at, and their squared distances from the queries' box."""

    nodes: Rows
    apart: Floats


def nearest_two(queries: BoxTree, points: BoxTree) -> Nearest:
    """Search the nearest two `points` of each of the `queries`, both in the order as given."""
    m = len(queries.rows)
    found = Nearest(np.empty(m), *(np.empty(shape, np.int64) for shape in ((m, 2), m, m)))
    parts = range(0, len(queries.leaves), LEAVES_AT_ONCE)
    in_threads(lambda i: _search(queries, i, i + LEAVES_AT_ONCE, points, found), parts)
    return found


@compiled
def _search(queries: BoxTree, start: int, end: int, points: BoxTree, found: Nearest) -> None:
    """Search from some of the queries' leaves, the nearest boxes of the points first."""
    q = queries.largest
    block = _Block(np.empty(q), np.empty((q, 3)), np.zeros((q, 2), np.int64))
    room, distances = 8 * points.depth, np.empty(points.largest)
    waiting = _Stack(np.zeros(room, np.int64), np.zeros(room))
    for leaf in queries.leaves[start:end]:
        bound = _begin(queries, leaf, points, block)
        size = 1  # of the stack, on whose ground the root stands
        while size > 0:
            size -= 1
            node = waiting.nodes[size]
            if waiting.apart[size] > bound:
                continue
            if points.children[node] > 0:
                size = _push(queries, leaf, points, node, bound, waiting, size)
            else:
                bound = _look(queries, leaf, points, node, block, distances)
        waiting.nodes[0], waiting.apart[0] = 0, 0.0
        _end(queries, leaf, points, block, found)


@inlined
def _begin(queries: BoxTree, leaf: int, points: BoxTree, block: _Block) -> float:
    """Nothing is found yet, but as near as the last find of the leaf before something must be."""
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
def _push(
    queries: BoxTree,
    leaf: int,
    points: BoxTree,
    node: int,
    bound: float,
    waiting: _Stack,
    size: int,
) -> int:
    """Put the children that are within the bound on the stack, the nearest on top."""
    box, ground = queries.boxes[leaf], size
    for child in range(points.first[node], points.first[node] + points.children[node]):
        other = points.boxes[child]
        dx = _gap(other[0] - box[3], box[0] - other[3])
        dy = _gap(other[1] - box[4], box[1] - other[4])
        dz = _gap(other[2] - box[5], box[2] - other[5])
        apart = dx * dx + dy * dy + dz * dz
        if apart <= bound:
            place = size
            while place > ground and waiting.apart[place - 1] < apart:
                waiting.apart[place] = waiting.apart[place - 1]
                waiting.nodes[place] = waiting.nodes[place - 1]
                place -= 1
            waiting.apart[place], waiting.nodes[place] = apart, child
            size += 1
    return size


@inlined
def _gap(above: float, below: float) -> float:
    """Distance of two intervals, or of one and a point, by how far one is above or below."""
    return max(0.0, above, below)


@inlined
def _look(
    queries: BoxTree, leaf: int, points: BoxTree, node: int, block: _Block, distances: Floats
) -> float:
    """Compare the queries with the points of a leaf; the largest of their limits then."""
    box, bound = points.boxes[node], 0.0
    x = points.columns[0, points.starts[node] : points.ends[node]]
    y = points.columns[1, points.starts[node] : points.ends[node]]
    z = points.columns[2, points.starts[node] : points.ends[node]]
    for i in range(queries.ends[leaf] - queries.starts[leaf]):
        query = queries.starts[leaf] + i
        qx, qy, qz = queries.columns[0, query], queries.columns[1, query], queries.columns[2, query]
        dx, dy, dz = (
            _gap(box[0] - qx, qx - box[3]),
            _gap(box[1] - qy, qy - box[4]),
            _gap(box[2] - qz, qz - box[5]),
        )
        limit = block.limits[i]
        if dx * dx + dy * dy + dz * dz <= limit:
            for j in range(len(x)):
                dx, dy, dz = qx - x[j], qy - y[j], qz - z[j]
                distances[j] = dx * dx + dy * dy + dz * dz
            for j in range(len(x)):
                if distances[j] <= limit:
                    limit = _keep(block, i, distances[j], points.starts[node] + j)
        bound = max(bound, limit)
    return bound


@inlined
def _keep(block: _Block, i: int, distance: float, place: int) -> float:
    """Sort a point in among the least distances of a query; the limit of the query then."""
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
def _end(queries: BoxTree, leaf: int, points: BoxTree, block: _Block, found: Nearest) -> None:
    for i in range(queries.ends[leaf] - queries.starts[leaf]):
        row, squared = queries.rows[queries.starts[leaf] + i], block.squared[i]
        nearest, other = points.rows[block.places[i, 0]], points.rows[block.places[i, 1]]
        exact, ties = 1, 1
        if squared[1] - squared[0] < SAME_DISTANCE:
            ties = 3 if squared[2] - squared[1] < SAME_DISTANCE else 2
            exact = 2 if squared[1] == squared[0] else 1
        else:
            other = nearest
        if exact == 2:
            nearest, other = min(nearest, other), max(nearest, other)
        found.squared[row], found.ties[row], found.exact[row] = squared[0], ties, exact
        found.rows[row, 0], found.rows[row, 1] = nearest, other

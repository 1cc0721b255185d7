"""Exact search for the points nearest to each query, with ties in the order of the tree."""

from __future__ import annotations

import numpy as np

from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pointkit.compiling import compiled, inlined
from pointkit.geometry.box_tree import BoxTree, box_tree, push
from pointkit.geometry.cloud import Floats
from pointkit.geometry.spatial_order import Rows, morton_order

_CHUNK_QUERIES = 1024


def nearest(queries: Floats, points: Floats, count: int, pool: ThreadPool) -> Rows:
    """Return the points nearest to each query.

    Of points at the same distance, those that precede in Morton order are nearer; of equal points,
    those that precede in `points`.

    Parameters
    ----------
    queries, points
        Coordinates (m, 3) and (n, 3), whole numbers below 2**25.
    count
        Number of points to find for each query, at most n.
    pool
        Threads; the result does not depend on their number.

    Returns
    -------
    ndarray
        Indices (m, count) of the points, the nearest first.
    """
    tree, order = box_tree(points), morton_order(queries)
    result = np.empty((len(queries), count), np.int64)

    def work(rows: slice, _: Scratch) -> None:
        _search(queries, order[rows], tree, result)

    pool.map_chunks(len(queries), _CHUNK_QUERIES, work)
    return result


@compiled
def _search(queries: Floats, order: Rows, points: BoxTree, result: Rows) -> None:
    count = result.shape[1]
    last = count - 1
    nodes, gaps = np.zeros(8 * points.depth, np.int64), np.zeros(8 * points.depth)
    squared, columns = np.empty(count), np.empty(count, np.int64)
    for row in order:
        x, y, z = queries[row]
        squared[:] = np.inf
        columns[:] = 0
        nodes[0], gaps[0], size = 0, 0.0, 1
        while size > 0:
            size -= 1
            node, gap = nodes[size], gaps[size]
            start, end = points.starts[node], points.ends[node]
            if not _is_nearer(gap, start, squared[last], columns[last]):
                continue
            if points.children[node] == 0:
                box = points.boxes[node]
                if box[0] == box[3] and box[1] == box[4] and box[2] == box[5]:
                    end = min(end, start + count)  # equal points, however many
                for column in range(start, end):
                    dx, dy, dz = (
                        points.columns[0, column] - x,
                        points.columns[1, column] - y,
                        points.columns[2, column] - z,
                    )
                    distance = dx * dx + dy * dy + dz * dz
                    if _is_nearer(distance, column, squared[last], columns[last]):
                        _insert(squared, columns, distance, column)
            base = size
            for child in range(points.first[node], points.first[node] + points.children[node]):
                box = points.boxes[child]
                dx = max(0.0, box[0] - x, x - box[3])
                dy = max(0.0, box[1] - y, y - box[4])
                dz = max(0.0, box[2] - z, z - box[5])
                gap = dx * dx + dy * dy + dz * dz
                if gap <= squared[last]:
                    push(nodes, gaps, base, size, child, gap)
                    size += 1
        result[row] = points.rows[columns]


@inlined
def _is_nearer(distance: float, column: int, other_distance: float, other_column: int) -> bool:
    return distance < other_distance or (distance == other_distance and column < other_column)


@inlined
def _insert(squared: Floats, columns: Rows, distance: float, column: int) -> None:
    place = len(squared) - 1
    while place > 0 and _is_nearer(distance, column, squared[place - 1], columns[place - 1]):
        squared[place], columns[place] = squared[place - 1], columns[place - 1]
        place -= 1
    squared[place], columns[place] = distance, column

"""The octree of a surface's samples, pruned where a plane costs less than what lies below it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives.layout import Ints, Leaves
from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import fit_plane


class Level(NamedTuple):
    """Occupied nodes of one level in Morton order.

    cells: (n, 3) at this level's size. moments: (n, 10). first: (n + 1,) places of the children in
    the next finer level. leaf: (n,) whether the node is one.
    """

    cells: Ints
    moments: Floats
    first: Ints
    leaf: NDArray[np.bool_]


def build(xyz: Floats, normals: Floats, weights: Floats, radius: float, depth: int) -> list[Level]:
    """Levels 0 (the root) to `depth` (unit cells) over the discs of samples."""
    cells = np.floor(xyz).astype(np.int64).clip(0, (1 << depth) - 1)
    order = np.argsort(_morton(cells), kind="stable")
    cells = cells[order]
    moments = moments_of(xyz[order], weights[order], normals[order], radius)
    levels: list[Level] = []
    for _ in range(depth + 1):
        changes = np.any(cells[1:] != cells[:-1], axis=1)
        starts = np.flatnonzero(np.concatenate([[True], changes]))
        bounds = np.concatenate([starts, [len(cells)]])
        moments = np.add.reduceat(moments, starts, axis=0)
        cells = cells[starts]
        levels.append(Level(cells, moments, bounds, np.zeros(len(cells), bool)))
        cells = cells >> 1
    return levels[::-1]


def prune(
    levels: list[Level],
    price: float,
    bits_leaf: float,
    bits_split: float,
    coarsest: int,
    finest: int,
) -> None:
    """Mark the leaves that make squared distance + price * bits least; none above `coarsest`."""
    below = np.zeros(0)
    for depth in range(finest, -1, -1):
        level = levels[depth]
        costs = plane_costs(level.moments) + price * bits_leaf
        if depth < finest:
            splitting = np.add.reduceat(below, level.first[:-1]) + price * bits_split
            level.leaf[:] = (costs < splitting) & (depth >= coarsest)
            costs = np.where(level.leaf, costs, splitting)
        else:
            level.leaf[:] = True
        below = costs


def leaves_of(levels: list[Level]) -> tuple[Ints, Leaves]:
    """The tree's leaves without planes, and their places (n,) in the list of all levels' nodes."""
    depth = len(levels) - 1
    corner, side, rows = [], [], []
    reached, start = np.ones(1, bool), 0
    for level, down in zip(levels, range(depth, -1, -1), strict=True):
        chosen = np.flatnonzero(reached & level.leaf)
        corner.append(level.cells[chosen] << down)
        side.append(np.full(len(chosen), 1 << down))
        rows.append(start + chosen)
        start += len(level.cells)
        reached = np.repeat(reached & ~level.leaf, np.diff(level.first)) if down else reached
    places = np.concatenate(rows)
    planes, counts = np.zeros(len(places), np.int64), np.array([len(places), 0])
    found = (np.concatenate(corner), np.concatenate(side))
    return places, Leaves(*found, planes, np.empty((0, 4)), counts)


def _morton(cells: Ints) -> Ints:
    keys = np.zeros(len(cells), np.int64)
    for bit in range(20):
        for axis in range(3):
            keys |= ((cells[:, axis] >> bit) & 1) << (3 * bit + 2 - axis)
    return keys


def cell_starts(points: Floats, cell: float) -> tuple[Ints, Ints]:
    """Order (n,) that brings the points of each cubic cell together, and where each cell begins."""
    cells = np.floor(points / cell).astype(np.int64)
    cells -= cells.min(axis=0)
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    return order, np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))


def moments_of(
    xyz: Floats,
    weights: Floats | float = 1.0,
    normals: Floats | None = None,
    radius: float = 0.0,
) -> Floats:
    """Moments (n, 10) of points, or of discs of `radius` about them, so that one has its plane."""
    x, y, z = xyz.T
    a, b, c = np.zeros_like(xyz.T) if normals is None else normals.T
    spread = radius**2 / 4
    columns = [np.ones(len(xyz)), x, y, z]
    columns += [x * x + spread * (1 - a * a), x * y - spread * a * b, x * z - spread * a * c]
    columns += [y * y + spread * (1 - b * b), y * z - spread * b * c, z * z + spread * (1 - c * c)]
    return np.asarray(np.stack(columns, axis=1) * np.broadcast_to(weights, len(xyz))[:, None])


@compiled
def plane_costs(moments: Floats) -> Floats:
    """Weighted sums of squared distances to the planes of least squares, (n,)."""
    costs: Floats = np.empty(len(moments))
    plane = np.empty(4)
    for i in range(len(moments)):
        costs[i] = fit_plane(moments[i], plane)
    return costs

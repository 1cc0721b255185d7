"""The encoder's octree of surface samples, pruned where one plane costs less than children."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats
from pointkit.geometry.moments import MOMENT_COUNT, distance_to_fit
from pointkit.geometry.morton import morton_codes
from primitive_codec.octree_arrays import Ints, Leaves


class PlaneOctreeLevel(NamedTuple):
    """The occupied nodes of one octree level, in Morton order."""

    cells: Ints  # (n, 3) coordinates at this level
    moments: Floats  # (n, 10) of the samples
    first_child: Ints  # (n + 1,) index in the next finer level
    is_leaf: NDArray[np.bool_]  # (n,)


def build_octree(
    xyz: Floats, normals: Floats, weights: Floats, radius: float, depth: int
) -> list[PlaneOctreeLevel]:
    """Build an octree of surface samples.

    Parameters
    ----------
    xyz
        Coordinates (n, 3) of the samples, in cells of the finest level.
    normals
        Unit normals (n, 3).
    weights
        Weights (n,) of the samples in the sum of squared distances.
    radius
        Radius, in cells, of the disc that each sample represents.
    depth
        Number of the finest level, whose nodes have side 1. The root is level 0.

    Returns
    -------
    list of PlaneOctreeLevel
        All levels, from the root to the finest. No node is marked as a leaf.
    """
    cells = np.floor(xyz).astype(np.int64).clip(0, (1 << depth) - 1)
    keys = morton_codes(cells, np.arange(3))
    order = np.argsort(keys, kind="stable")
    cells, keys = cells[order], keys[order]
    moments = moments_of(xyz[order], weights[order], normals[order], radius)
    levels: list[PlaneOctreeLevel] = []
    for _ in range(depth + 1):
        starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
        bounds = np.concatenate([starts, [len(cells)]])
        moments = np.add.reduceat(moments, starts, axis=0)
        cells, keys = cells[starts], keys[starts] >> 3
        levels.append(PlaneOctreeLevel(cells, moments, bounds, np.zeros(len(cells), bool)))
        cells = cells >> 1
    return levels[::-1]


def prune_octree(
    levels: list[PlaneOctreeLevel],
    lmbda: float,
    leaf_bits: float,
    split_bits: float,
    coarsest_leaf_level: int,
    finest_leaf_level: int,
) -> None:
    """Decide which nodes of an octree become leaves, and mark them in place.

    The decision minimises the sum of squared distances to the leaves' planes plus lmbda * bits.

    Parameters
    ----------
    levels
        Levels of the octree, from the root on; `is_leaf` of each level is overwritten.
    lmbda
        Weight of a bit, in squared cells.
    leaf_bits, split_bits
        Estimated bits of one leaf's plane, and of one split into children.
    coarsest_leaf_level, finest_leaf_level
        Levels of the largest and of the smallest leaves that are allowed; level 0 is the root.
    """
    child_costs = np.zeros(0)
    for depth in range(finest_leaf_level, -1, -1):
        level = levels[depth]
        costs = plane_errors(level.moments) + lmbda * leaf_bits
        if depth < finest_leaf_level:
            split_costs = np.add.reduceat(child_costs, level.first_child[:-1]) + lmbda * split_bits
            level.is_leaf[:] = (costs < split_costs) & (depth >= coarsest_leaf_level)
            costs = np.where(level.is_leaf, costs, split_costs)
        else:
            level.is_leaf[:] = True
        child_costs = costs


def collect_leaves(levels: list[PlaneOctreeLevel]) -> tuple[Ints, Leaves]:
    """List the leaves of a pruned octree.

    Returns
    -------
    node_indices
        Index (n,) of each leaf among the nodes of all levels, counted from the root on.
    leaves
        Corners and sides of the leaves; their planes are still empty.
    """
    depth = len(levels) - 1
    corner, side, level_indices = [], [], []
    is_reached, start = np.ones(1, bool), 0
    for level, side_log2 in zip(levels, range(depth, -1, -1), strict=True):
        rows = np.flatnonzero(is_reached & level.is_leaf)
        corner.append(level.cells[rows] << side_log2)
        side.append(np.full(len(rows), 1 << side_log2))
        level_indices.append(start + rows)
        start += len(level.cells)
        if side_log2:
            is_reached = np.repeat(is_reached & ~level.is_leaf, np.diff(level.first_child))
    node_indices = np.concatenate(level_indices)
    planes, counts = np.zeros(len(node_indices), np.int64), np.array([len(node_indices), 0])
    leaves = Leaves(np.concatenate(corner), np.concatenate(side), planes, np.empty((0, 4)), counts)
    return node_indices, leaves


def moments_of(
    xyz: Floats,
    weights: Floats | float = 1.0,
    normals: Floats | None = None,
    radius: float = 0.0,
) -> Floats:
    """Return the weighted moments of samples, to which planes can be fitted by least squares.

    Parameters
    ----------
    xyz
        Coordinates (n, 3).
    weights
        Weights (n,), or one number for all samples.
    normals, radius
        Unit normals (n, 3) and radius, if each sample represents a disc; by default, samples are
        points.

    Returns
    -------
    ndarray
        (n, 10): 1, x, y, z, xx, xy, xz, yy, yz and zz, each multiplied by the weight. For discs,
        the products are averages over the disc. Moments of a group are sums of these rows.
    """
    normals = np.zeros((1, 3)) if normals is None else normals
    variance, (i, j) = radius**2 / 4, (np.array([0, 0, 1]), np.array([1, 2, 2]))
    squares = xyz**2 + variance * (1 - normals**2)
    products = xyz[:, i] * xyz[:, j] - variance * normals[:, i] * normals[:, j]
    moments = np.empty((len(xyz), MOMENT_COUNT))
    moments[:, 0], moments[:, 1:4] = 1.0, xyz
    moments[:, [4, 7, 9]], moments[:, [5, 6, 8]] = squares, products
    return np.asarray(moments * np.reshape(weights, (-1, 1)))


@compiled
def plane_errors(moments: Floats) -> Floats:
    """Return the weighted sum of squared distances from each group to its best plane.

    Parameters
    ----------
    moments
        Moments (n, 10) of groups of samples, as `moments_of` defines them.

    Returns
    -------
    ndarray
        One sum (n,) for each group.
    """
    costs: Floats = np.empty(len(moments))
    for i in range(len(moments)):
        costs[i] = distance_to_fit(moments[i])
    return costs

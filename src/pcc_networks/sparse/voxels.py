"""Sets of voxels in Morton order: 64-bit keys, coarser sets, and neighbour tables.

The key of a voxel interleaves the bits of x, y and z, x lowest. The key of the parent, i.e. the
voxel of twice the side, is ``key >> 3``. The number of a child within its parent is ``key & 7``,
which equals ``x + 2 y + 4 z``. Children of a voxel follow each other in Morton order. The slot of a
child is 8 times the row of its parent plus the number of the child.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
from pointkit.geometry.morton import morton_codes, morton_points

if TYPE_CHECKING:
    from pcc_networks.sparse.thread_pool import ThreadPool

Keys = NDArray[np.int64]
NeighbourTable = NDArray[np.int32]
AXIS_BITS = 20
"""Coordinates are below 2**20, so that the keys of a voxel and of its neighbours fit 63 bits."""
OFFSETS = 27
"""Offsets of neighbours, zero included; their indices are ``dx + 1 + 3 (dy + 1) + 9 (dz + 1)``."""
FACES = (12, 14, 10, 16, 4, 22)
"""Indices of the offsets across faces, in both directions along x, y and z."""
CENTRE = 13
CHILDREN = 8

_X_LOWEST = np.array([2, 1, 0])
"""Order of the axes in a key, for `pointkit.geometry.morton`."""


@dataclass(frozen=True)
class VoxelSet:
    """A set of occupied voxels in Morton order, with a table of their neighbours."""

    keys: Keys  # (n,), ascending
    neighbours: NeighbourTable  # (27, n), row of the voxel at each offset, or -1

    def __len__(self) -> int:
        return len(self.keys)


@dataclass(frozen=True)
class ChildMap:
    """The children of each voxel of a coarser set."""

    first: NDArray[np.int64]  # (m + 1,); parent p has the rows first[p] to first[p + 1]
    slots: NDArray[np.int64]  # (n,), 8 * parent + child number


def morton_keys(voxels: NDArray[np.integer[Any]]) -> Keys:
    """Return the Morton keys (n,) of voxels (n, 3) with coordinates in [0, 2**20)."""
    return morton_codes(np.ascontiguousarray(voxels, dtype=np.int64), _X_LOWEST)


def morton_voxels(keys: Keys) -> NDArray[np.int64]:
    """Return the voxels (n, 3) with these Morton keys (n,)."""
    return morton_points(np.ascontiguousarray(keys), _X_LOWEST, np.zeros(3, np.int64))


def unique_keys(keys: Keys) -> Keys:
    """Return the sorted distinct keys, faster than `numpy.unique`."""
    ordered: Keys = np.sort(keys)
    return np.asarray(ordered[np.diff(ordered, prepend=-1) != 0])


def parents_of(keys: Keys) -> tuple[Keys, ChildMap]:
    """Return the parents of voxels.

    Parameters
    ----------
    keys
        Sorted keys (n,) of the voxels.

    Returns
    -------
    parents
        Sorted keys (m,) of the parents.
    child_map
        The rows of the children of each parent.
    """
    parents = keys >> 3
    starts = np.flatnonzero(np.diff(parents, prepend=-1))
    parent = np.cumsum(np.diff(parents, prepend=-1) != 0) - 1
    return parents[starts], ChildMap(np.append(starts, len(keys)), 8 * parent + (keys & 7))


def pyramid(
    keys: Keys, scales: int, pool: ThreadPool | None = None
) -> tuple[list[VoxelSet], list[ChildMap]]:
    """Build coarser and coarser sets of voxels.

    Neighbour tables need no search, because the neighbours of a child are children of its parent's
    neighbours.

    Parameters
    ----------
    keys
        Sorted distinct Morton keys (n,) of the finest voxels.
    scales
        Number of coarser sets.
    pool
        Threads that compute the tables.

    Returns
    -------
    sets
        The finest set and the coarser sets, finest first.
    child_maps
        The map from each set to the next coarser one.
    """
    sets, child_maps = [keys], []
    while len(sets) <= scales or len(sets[-1]) > 1:
        coarser, child_map = parents_of(sets[-1])
        sets.append(coarser)
        child_maps.append(child_map)
    voxels = [_root(sets[-1])]
    for fine in reversed(sets[:-1]):
        voxels.append(children_voxels(voxels[-1], fine, pool))
    return voxels[::-1][: scales + 1], child_maps[:scales]


def _root(keys: Keys) -> VoxelSet:
    table = np.full((OFFSETS, 1), -1, dtype=np.int32)
    table[CENTRE] = 0
    return VoxelSet(keys, table)


def children_voxels(parents: VoxelSet, keys: Keys, pool: ThreadPool | None = None) -> VoxelSet:
    """Return the set of children with keys (n,), of which each parent must have at least one."""
    first = np.append(np.flatnonzero(np.diff(keys >> 3, prepend=-1)), len(keys))
    rows = np.full((len(parents), CHILDREN), -1, dtype=np.int32)
    rows[np.repeat(np.arange(len(parents)), np.diff(first)), keys & 7] = np.arange(len(keys))
    table = np.empty((OFFSETS, len(keys)), dtype=np.int32)

    def work(chunk: slice, _: object = None) -> None:
        steps = (_ring_parents(), _ring_cells(), chunk.start, chunk.stop)
        _fill_neighbours(parents.neighbours, first, keys, rows, *steps, table)

    if pool is None:
        work(slice(0, len(parents)))
    else:
        pool.map_chunks(len(parents), -(-len(parents) // pool.threads), work)
    return VoxelSet(keys, table)


def occupancies(keys: Keys) -> NDArray[np.uint8]:
    """Return the occupancy (m,) of the parents of voxels with sorted keys (n,).

    The bits of an occupancy say which of the eight children exist.
    """
    starts = np.flatnonzero(np.diff(keys >> 3, prepend=-1))
    return np.add.reduceat((1 << (keys & 7)).astype(np.uint8), starts, dtype=np.uint8)


def slots_of_occupancies(occupancy: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the slots (n,) of all children that occupancies (m,) declare occupied."""
    return np.flatnonzero(occupancy[:, None] >> np.arange(CHILDREN, dtype=np.uint8) & 1)


def keys_of_slots(parents: Keys, slots: NDArray[np.int64]) -> Keys:
    """Return the keys (n,) of the children at slots (n,) of parents with keys (m,)."""
    keys: Keys = (parents[slots >> 3] << 3) | (slots & 7)
    return keys


def selected_children(
    parents: VoxelSet, slots: NDArray[np.int64], pool: ThreadPool | None = None
) -> VoxelSet:
    """Return the set of children at ascending slots (n,), of which a parent may have none."""
    has_child = np.zeros(len(parents), dtype=bool)
    has_child[slots >> 3] = True
    row = np.where(has_child, np.cumsum(has_child) - 1, -1).astype(np.int32)
    table = parents.neighbours[:, has_child]
    kept_parents = VoxelSet(parents.keys[has_child], np.where(table < 0, -1, row[table]))
    return children_voxels(kept_parents, keys_of_slots(parents.keys, slots), pool)


def top_k(logits: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Return the ascending indices of the `count` largest logits; ties go to lower indices."""
    if count >= len(logits):
        return np.arange(len(logits))
    least = np.partition(logits, len(logits) - count)[len(logits) - count]
    selected = logits > least
    ties = np.flatnonzero(logits == least)
    selected[ties[: count - np.count_nonzero(selected)]] = True
    return np.flatnonzero(selected)


def kept_children(
    logits: NDArray[np.float32], count: int, child_per_parent: bool = True
) -> NDArray[np.int64]:
    """Select the most likely children of voxels.

    Parameters
    ----------
    logits
        Logits (m, 8) of the occupancy of the children of each parent.
    count
        Number of children to keep.
    child_per_parent
        Whether the most likely child of each parent has priority. If False, a parent may lose all
        its children.

    Returns
    -------
    ndarray
        Ascending slots of the kept children, 8 * parent + child.
    """
    if not child_per_parent:
        return top_k(logits.reshape(-1), count)
    best = logits.argmax(axis=1)
    rows = np.arange(len(logits))
    if count <= len(logits):
        selected = top_k(logits[rows, best], count)
        slots: NDArray[np.int64] = CHILDREN * selected + best[selected]
        return slots
    ranked = logits.copy()
    ranked[rows, best] = np.inf
    return top_k(ranked.reshape(-1), count)


@cache
def _ring_parents() -> NDArray[np.int64]:
    position = np.arange(64) // 4 ** np.arange(3)[:, None] % 4 - 1
    parents, within = position // 2 + 1, position % 2
    return np.stack([3 ** np.arange(3) @ parents, 2 ** np.arange(3) @ within])


@cache
def _ring_cells() -> NDArray[np.int64]:
    child, offset = np.meshgrid(np.arange(8), np.arange(OFFSETS), indexing="ij")
    steps = [(child >> axis & 1) + offset // 3**axis % 3 for axis in range(3)]
    return np.asarray(sum(step * 4**axis for axis, step in enumerate(steps)))


@compiled
def _fill_neighbours(
    parent_table: NeighbourTable,
    first: NDArray[np.int64],
    keys: Keys,
    rows: NeighbourTable,
    ring_parents: NDArray[np.int64],
    ring_cells: NDArray[np.int64],
    first_parent: int,
    last_parent: int,
    table: NeighbourTable,
) -> None:
    parent_neighbours, ring = np.empty(OFFSETS, np.int64), np.empty(64, np.int32)
    for parent in range(first_parent, last_parent):
        for offset in range(OFFSETS):
            parent_neighbours[offset] = parent_table[offset, parent]
        for i in range(64):
            neighbour = parent_neighbours[ring_parents[0, i]]
            ring[i] = -1 if neighbour < 0 else rows[neighbour, ring_parents[1, i]]
        for row in range(first[parent], first[parent + 1]):
            child = keys[row] & 7
            for offset in range(OFFSETS):
                table[offset, row] = ring[ring_cells[child, offset]]

"""Voxel sets in Morton order: 64-bit keys, coarser sets, and tables of neighbours.

The key of a voxel interleaves the bits of x, y and z, x lowest. In that order the up to eight
children of a voxel stand together, the keys of the next coarser set are ``keys >> 3``, and a
child's number within its parent, ``key & 7``, is ``x + 2 y + 4 z`` of its corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.geometry.morton import morton_codes, morton_points

if TYPE_CHECKING:
    from puckbench.learned.sparse.thread_pool import ThreadPool

Keys = NDArray[np.int64]
NeighbourTable = NDArray[np.int32]
AXIS_BITS = 20
"""Coordinates are below 2**20, so that a key and its neighbours fit 63 bits."""
OFFSETS = 27
"""Neighbours within one voxel, itself among them: ``(dx + 1) + 3 (dy + 1) + 9 (dz + 1)``."""
FACES = (12, 14, 10, 16, 4, 22)
"""Those that share a face: to and fro along x, y and z."""
CENTRE = 13
CHILDREN = 8

_X_LOWEST = np.array([2, 1, 0])
"""Order of the axes in a key, for `puckbench.geometry.morton`."""


@dataclass(frozen=True)
class VoxelSet:
    """Distinct voxels in Morton order.

    Parameters
    ----------
    keys
        (n,) int64, ascending.
    neighbours
        (27, n) int32, the row of the voxel at each offset, or -1 where there is none.
    """

    keys: Keys
    neighbours: NeighbourTable

    def __len__(self) -> int:
        return len(self.keys)


@dataclass(frozen=True)
class ChildMap:
    """Which voxels of a set are the children of which voxel of the next coarser set.

    Parameters
    ----------
    first
        (m + 1,) int64, the children of parent p are the rows first[p] to first[p + 1].
    slots
        (n,) int64, ``8 * parent + child number`` of each child.
    """

    first: NDArray[np.int64]
    slots: NDArray[np.int64]


def morton_keys(voxels: NDArray[np.integer[Any]]) -> Keys:
    """Keys (n,) of voxels (n, 3) with coordinates in [0, 2**20)."""
    return morton_codes(np.ascontiguousarray(voxels, dtype=np.int64), _X_LOWEST)


def morton_voxels(keys: Keys) -> NDArray[np.int64]:
    """Voxels (n, 3) of keys (n,)."""
    return morton_points(np.ascontiguousarray(keys), _X_LOWEST, np.zeros(3, np.int64))


def unique_keys(keys: Keys) -> Keys:
    """Keys in order without duplicates; `numpy.unique` is slower, since it makes a hash table."""
    ordered: Keys = np.sort(keys)
    return np.asarray(ordered[np.diff(ordered, prepend=-1) != 0])


def parents_of(keys: Keys) -> tuple[Keys, ChildMap]:
    """Keys of the next coarser set, and the children of each of its voxels."""
    above = keys >> 3
    starts = np.flatnonzero(np.diff(above, prepend=-1))
    parent = np.cumsum(np.diff(above, prepend=-1) != 0) - 1
    return above[starts], ChildMap(np.append(starts, len(keys)), 8 * parent + (keys & 7))


def pyramid(
    keys: Keys, scales: int, pool: ThreadPool | None = None
) -> tuple[list[VoxelSet], list[ChildMap]]:
    """A set of voxels and its coarser sets with their tables of neighbours.

    The tables are made from the coarsest set down: a child's neighbours are children of its
    parent's neighbours, so nothing is ever searched for.

    Parameters
    ----------
    keys
        (n,), ascending and distinct.
    scales
        Number of coarser sets.
    pool
        Threads that share the work.

    Returns
    -------
    tuple
        The `scales` + 1 sets, finest first, and the `scales` maps from one to the next.
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
    """The set of some children of the parents, at least one of each, by their keys (n,)."""
    first = np.append(np.flatnonzero(np.diff(keys >> 3, prepend=-1)), len(keys))
    rows = np.full((len(parents), CHILDREN), -1, dtype=np.int32)
    rows[np.repeat(np.arange(len(parents)), np.diff(first)), keys & 7] = np.arange(len(keys))
    table = np.empty((OFFSETS, len(keys)), dtype=np.int32)

    def work(part: slice, _: object = None) -> None:
        steps = (_around(), _near_child(), part.start, part.stop)
        _fill_neighbours(parents.neighbours, first, keys, rows, *steps, table)

    if pool is None:
        work(slice(0, len(parents)))
    else:
        pool.map_chunks(len(parents), -(-len(parents) // pool.threads), work)
    return VoxelSet(keys, table)


def keys_of_slots(parents: Keys, slots: NDArray[np.int64]) -> Keys:
    """Keys (n,) of the children in slots (n,), ``8 * row of the parent + child number``."""
    keys: Keys = (parents[slots >> 3] << 3) | (slots & 7)
    return keys


def selected_children(
    parents: VoxelSet, slots: NDArray[np.int64], pool: ThreadPool | None = None
) -> VoxelSet:
    """The set of the children in ascending slots; some parents may have none."""
    stays = np.zeros(len(parents), dtype=bool)
    stays[slots >> 3] = True
    row = np.where(stays, np.cumsum(stays) - 1, -1).astype(np.int32)
    table = parents.neighbours[:, stays]
    left = VoxelSet(parents.keys[stays], np.where(table < 0, -1, row[table]))
    return children_voxels(left, keys_of_slots(parents.keys, slots), pool)


@cache
def _around() -> NDArray[np.int64]:
    """Of the 4x4x4 voxels around a parent's children, x fastest: the offset of the parent that each
    belongs to, and its number there, (2, 64)."""
    position = np.arange(64) // 4 ** np.arange(3)[:, None] % 4 - 1
    above, within = position // 2 + 1, position % 2
    return np.stack([3 ** np.arange(3) @ above, 2 ** np.arange(3) @ within])


@cache
def _near_child() -> NDArray[np.int64]:
    """Which of the 4x4x4 voxels around is at each offset of each child, (8, 27)."""
    child, offset = np.meshgrid(np.arange(8), np.arange(OFFSETS), indexing="ij")
    steps = [(child >> axis & 1) + offset // 3**axis % 3 for axis in range(3)]
    return np.asarray(sum(step * 4**axis for axis, step in enumerate(steps)))


@compiled
def _fill_neighbours(
    parent_table: NeighbourTable,
    first: NDArray[np.int64],
    keys: Keys,
    rows: NeighbourTable,
    around: NDArray[np.int64],
    near: NDArray[np.int64],
    first_parent: int,
    last_parent: int,
    table: NeighbourTable,
) -> None:
    others, cube = np.empty(OFFSETS, np.int64), np.empty(64, np.int32)
    for parent in range(first_parent, last_parent):
        for offset in range(OFFSETS):
            others[offset] = parent_table[offset, parent]
        for i in range(64):
            other = others[around[0, i]]
            cube[i] = -1 if other < 0 else rows[other, around[1, i]]
        for row in range(first[parent], first[parent + 1]):
            child = keys[row] & 7
            for offset in range(OFFSETS):
                table[offset, row] = cube[near[child, offset]]

"""Occupied neighbours of an octree node, which are found in an atlas, i.e. a map of occupancies.

The atlas covers a cube of 2**neighbour_avail_boundary_log2 nodes per side; neighbours outside the
cube count as empty. Without an atlas, only siblings are known. In TMC13:
`makeGeometryNeighPattern`, `MortonMap3D`, `predictGeometryOccupancyIntra`.
"""

from __future__ import annotations

import threading
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from gpcc.arithmetic import Bytes
from gpcc.compiled import integer, kernel
from pointkit.coding.intrinsics import bit_count
from pointkit.compiling import inlined
from pointkit.geometry.morton import (
    AXES_BITS,
    X_BITS,
    Y_BITS,
    Z_BITS,
    Ints,
    first_child_code,
    parent_code,
)

# Along x, y, z: mask of the children in the upper half, and their index minus that of the lower
# child beside them.
UPPER = np.array([0xF0, 0xCC, 0xAA], dtype=np.int64)
_STEP = np.array([4, 2, 1], dtype=np.int64)
_AXIS = np.array([X_BITS, Y_BITS, Z_BITS], dtype=np.int64)
_PATTERN_BIT = np.array([2, 4, 16], dtype=np.int64)
# Bits of a neighbour pattern for the neighbours before and after along x, y, z.
BEFORE = np.array([1, 2, 4], dtype=np.int64)
AFTER = np.array([0, 3, 5], dtype=np.int64)


def _grid_cell(x: int, y: int, z: int) -> int:
    return 16 * x + 4 * y + z


# A node and its 26 neighbours lie in a 4 x 4 x 4 grid of bits around the node's parent.
_CHILD_CELL = np.array([_grid_cell(*place) for place in np.ndindex(2, 2, 2)], dtype=np.int64)
_GRID_OF_OCCUPANCY = np.array(
    [sum((o >> k & 1) << int(cell) for k, cell in enumerate(_CHILD_CELL)) for o in range(256)],
    dtype=np.int64,
)
_AROUND = sum(1 << _grid_cell(*place) for place in np.ndindex(3, 3, 3)) - (1 << _grid_cell(1, 1, 1))
# The seven neighbours of a node that touch child k.
_TOUCHING = np.array(
    [
        sum(1 << _grid_cell(*place) for place in product((1, 2 * x), (1, 2 * y), (1, 2 * z)))
        - (1 << _grid_cell(1, 1, 1))
        for x, y, z in np.ndindex(2, 2, 2)
    ],
    dtype=np.int64,
)
_LOWER_CELLS = (0x00000033, 0x00030003, 0x00110011)
_ALL_CELLS = 0x00330033


def _grid_placement(axes: int, offsets: tuple[int, ...]) -> tuple[int, int]:
    cut, shift = _ALL_CELLS, 0
    for axis, offset in enumerate(offsets):
        split = axes >> (2 - axis) & 1
        shift += (16, 4, 1)[axis] * (1 + (1 + split) * offset)
        if split and offset:
            cut &= _LOWER_CELLS[axis] if offset > 0 else ~_LOWER_CELLS[axis]
    return cut, shift


_GRID_PLACING = np.array(
    [[_grid_placement(a, offsets) for offsets in product((-1, 0, 1), repeat=3)] for a in range(8)],
    dtype=np.int64,
)
_GRID_CUT, _GRID_SHIFT = np.moveaxis(_GRID_PLACING, 2, 0).copy().reshape(2, 8, 3, 3, 3)


class OccupancyAtlas(NamedTuple):
    """Occupancies, by Morton code, of the parents in a cube and of the nodes coded so far."""

    parents: Bytes
    nodes: Bytes
    # Log2 of the number of nodes per side, or 0 if only siblings are known.
    side: int


def empty_atlas(boundary: int) -> OccupancyAtlas:
    size = 1 << 3 * boundary if boundary else 1
    return OccupancyAtlas(np.zeros(size, dtype=np.uint8), np.zeros(size, dtype=np.uint8), boundary)


class _UnusedAtlases(threading.local):
    """Atlases of each thread by side; new ones take as long as some thousand nodes."""

    @cached_property
    def by_side(self) -> dict[int, OccupancyAtlas]:
        return {}


_UNUSED = _UnusedAtlases()


def borrowed_atlas(boundary: int) -> OccupancyAtlas:
    """Return an atlas without parents, which may be an atlas that was returned before."""
    return _UNUSED.by_side.pop(boundary, None) or empty_atlas(boundary)


def return_atlas(atlas: OccupancyAtlas) -> None:
    """Keep an atlas, whose parents have been removed again, for this thread's next slice."""
    _UNUSED.by_side[atlas.side] = atlas


@kernel
def update_atlas(
    atlas: OccupancyAtlas, morton: Ints, occupancy: Bytes, axes: int, previous: int, first: int
) -> int:
    """Replace the parents in the atlas by those of the next cube.

    Parameters
    ----------
    previous, first
        Parents `previous` to `first` - 1 are those of the last cube; those of the next begin at
        `first`.

    Returns
    -------
    int
        End of the parents of the next cube.
    """
    inside = (1 << 3 * atlas.side) - 1
    for i in range(previous, first):
        atlas.parents[parent_code(first_child_code(morton[i], axes) & inside, axes)] = 0
    if first == len(morton):
        return first
    cube = first_child_code(morton[first], axes) >> 3 * atlas.side
    end = first
    while end < len(morton):
        base = first_child_code(morton[end], axes)
        if base >> 3 * atlas.side != cube:
            break
        atlas.parents[parent_code(base & inside, axes)] = occupancy[end]
        end += 1
    return end


@inlined
def _adjacent_occupancy(
    atlas: OccupancyAtlas, axes: int, address: int, axis: int, towards: int
) -> int:
    bits = _AXIS[axis]
    levels = atlas.side - ((axes >> (2 - axis)) & 1)
    place = address & bits
    if towards > 0:
        if place == bits & ((1 << 3 * levels) - 1):
            return 0
        moved = ((address | ~bits) + 1) & bits
    else:
        if place == 0:
            return 0
        moved = (place - 1) & bits
    return integer(atlas.parents[moved | address & ~bits])


@kernel
def face_neighbours(atlas: OccupancyAtlas, axes: int, base: int, occupancy: int) -> int:
    """Return six masks of a parent's children in one integer, one byte each.

    Bit c of byte k says whether child c has an occupied neighbour in the direction of bit k of a
    neighbour pattern (see `contexts`).
    """
    address = parent_code(base & ((1 << 3 * atlas.side) - 1), axes)
    faces = 0
    for axis in range(3):
        upper, step = UPPER[axis], _STEP[axis]
        after, before = (occupancy & upper) >> step, (occupancy & ~upper) << step
        if atlas.side:
            following = _adjacent_occupancy(atlas, axes, address, axis, 1)
            preceding = _adjacent_occupancy(atlas, axes, address, axis, -1)
            if axes & step:
                after |= (following & ~upper) << step
                before |= (preceding & upper) >> step
            else:
                after, before = following, preceding
        faces |= after << 8 * AFTER[axis] | (before & 0xFF) << 8 * BEFORE[axis]
    return faces


@inlined
def neigh_pattern_of(faces: int, child: int) -> int:
    neigh_pattern = 0
    for k in range(6):
        neigh_pattern |= (faces >> (8 * k + child) & 1) << k
    return neigh_pattern


@kernel
def refine_by_adjacent_children(
    atlas: OccupancyAtlas, axes: int, node: int, neigh_pattern: int
) -> tuple[int, int, int, int, int]:
    """Remove neighbours from a node's neighbour pattern if none of their children touches the node.

    Only the neighbours x-1, y-1 and z-1 are coded before the node, and can be removed.

    Returns
    -------
    neigh_pattern
        The pattern without the removed neighbours.
    adjacency_gt0, adjacency_gt1, adjacency_unocc
        Masks of the node's children that touch one occupied child, two occupied children, or an
        empty child of these neighbours.
    occupancies
        Occupancies of these neighbours, one byte each.
    """
    inside = (1 << 3 * atlas.side) - 1
    address = node & inside
    gt0, gt1, unocc, adjacent_occupancies = 0, 0, 0, 0
    for axis in range(3):
        if neigh_pattern & _PATTERN_BIT[axis] == 0:
            continue
        bits = _AXIS[axis]
        beside = ((address & bits) - 1) & bits | address & ~bits
        occupancy = integer(atlas.nodes[beside])
        adjacent_occupancies |= occupancy << 8 * axis
        facing, step = UPPER[axis], _STEP[axis]
        if axes & step == 0:
            facing, step = facing ^ 0xFF, 0
        facing_children = (occupancy & facing) >> step
        if facing_children == 0:
            neigh_pattern ^= _PATTERN_BIT[axis]
        gt1 |= gt0 & facing_children
        gt0 |= facing_children
        unocc |= (~occupancy & facing) >> step
    return neigh_pattern, gt0, gt1, unocc, adjacent_occupancies


@kernel
def neighbour_grid(atlas: OccupancyAtlas, axes: int, base: int) -> int:
    """Return a 64-bit mask of the occupied nodes in a 4 x 4 x 4 grid around a parent's children.

    Bit 16 x + 4 y + z is the node at (x, y, z); the children have the coordinates 1 and 2.
    """
    inside = (1 << 3 * atlas.side) - 1
    address = parent_code(base & inside, axes)
    within = parent_code(inside & ~(AXES_BITS[axes] & 7), axes)
    grid = 0
    for x in range(3):
        along_x = _moved(address, within, X_BITS, x)
        for y in range(3):
            along_y = _moved(address, within, Y_BITS, y)
            for z in range(3):
                along_z = _moved(address, within, Z_BITS, z)
                if along_x < 0 or along_y < 0 or along_z < 0:
                    continue
                cells = _GRID_OF_OCCUPANCY[atlas.parents[along_x | along_y | along_z]]
                cells &= _GRID_CUT[axes, x, y, z]
                shift = _GRID_SHIFT[axes, x, y, z]
                grid |= cells << shift if shift >= 0 else cells >> -shift
    return grid


@inlined
def _moved(address: int, within: int, bits: int, place: int) -> int:
    """Return a Morton code moved by `place` - 1 nodes along the axis of `bits`."""
    # Returns the moved code's bits of this axis, or -1 outside the cube.
    along = address & bits
    if place == 1:
        return along
    if place == 0:
        return -1 if along == 0 else (along - 1) & bits
    return -1 if along == within & bits else ((address | ~bits) + 1) & bits


@kernel
def predict_occupancy(grid: int, child: int) -> tuple[int, int]:
    """Predict which children of a node are occupied, from the result of `neighbour_grid`.

    Returns
    -------
    predicted, occupied
        Mask of the children with a prediction, and mask of those predicted as occupied.
    """
    neighbourhood = (grid >> _CHILD_CELL[child]) & _AROUND
    threshold = 4 if bit_count(neighbourhood) < 14 else 5
    is_predicted, prediction = 0, 0
    for k in range(8):
        touching = bit_count(neighbourhood & _TOUCHING[k])
        is_predicted |= integer(touching <= 2 or touching >= threshold) << k
        prediction |= integer(touching >= threshold) << k
    return is_predicted, prediction

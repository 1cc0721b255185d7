"""Adaptive contexts of octree geometry, and the tables by which they are selected.

A neighbour pattern is a mask of occupied face neighbours: 1 for x+1, 2 for x-1, 4 for y-1, 8 for
y+1, 16 for z-1, 32 for z+1. The index of a child is 4x + 2y + z, and an occupancy is a mask of
children. In TMC13: `GeometryOctreeContexts`, `tables.cpp`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.arithmetic import HALF
from gpcc.compiled import integer

# Indices into the probabilities; a comment states the number of contexts if there are several.
# `integer` hides the values from the compiler, which would compile code_bit once for each literal.
CTX_OCCUPANCY = integer(0)  # 32
CTX_SINGLE_CHILD = integer(32)
CTX_DUP_POINT_CNT_GT0 = integer(33)
CTX_DUP_POINT_CNT_GT1 = integer(34)
CTX_DUP_POINT_CNT_EGL = integer(35)
CTX_BLOCK_SKIP_TH = integer(36)
CTX_NUM_IDCM_POINTS_GT1 = integer(37)
CTX_SAME_BIT_HIGH = integer(38)  # 3 axes x 5
CTX_PLANAR_MODE = integer(53)  # 3 axes
CTX_PLANE_LAST_INDEX_Z = integer(56)  # 3
CTX_PLANE_LAST_INDEX = integer(59)  # 3 axes x 3 x 4
CTX_THETA_RES = integer(95)  # 3
CTX_THETA_RES_SIGN = integer(98)
CTX_THETA_RES_EXP = integer(99)
CTX_PLANE_ANGULAR = integer(100)  # 4
CTX_PLANE_ANGULAR_IDCM = integer(104)  # 4
CTX_PLANE_ANGULAR_PHI = integer(108)  # 8
CTX_PLANE_ANGULAR_PHI_IDCM = integer(116)  # 8
_COUNT = 124

# Number of map entries for each of the eight coded bits.
_MAP_LENGTHS = (9, 18, 35, 68, 69, 134, 135, 136)
CTX_MAP_SIZE = sum(_MAP_LENGTHS)
CTX_MAP_COUNT = 18
_MAP_STARTS = (0, *np.cumsum(_MAP_LENGTHS[:-1]).tolist())

# Change of a map entry e, indexed by (255 - e) >> 4 after a one and by e >> 4 after a zero.
CTX_MAP_DELTA = np.array(
    [0, 1, 1, 2, 4, 7, 9, 11, 14, 16, 19, 23, 22, 18, 13, 6],
    dtype=np.int64,
)

# Classes of neighbours for the last three bits, indexed by unoccupied + 2 * (number occupied).
ADJACENCY_REDUCED = np.array([0, 0, 1, 2, 3, 3], dtype=np.int64)

_CODING_ORDER = (1, 7, 5, 3, 2, 6, 4, 0)

# Symmetry classes of the 64 neighbour patterns, with an atlas, and with siblings only.
_CLASSES_9, _SIBLING_CLASSES = (
    tuple(map(int, digits))
    for digits in (
        "0111122312231334122325562556366712232556255636671334366736674778",
        "0550511051100000233037703770000023303770377000000000000000000000",
    )
)
_CLASSES_5 = (0, 1, 2, 3, 1, 2, 3, 4, 4)
_CLASSES_3 = (0, 1, 1, 2, 2, 1, 2, 2, 2)

# New index of each child after a rotation or reflection of its node.
_X90 = (1, 3, 0, 2, 5, 7, 4, 6)
_X270_Y180 = (7, 5, 6, 4, 3, 1, 2, 0)
_X90_Y180 = (4, 6, 5, 7, 0, 2, 1, 3)
_Y270 = (1, 5, 3, 7, 0, 4, 2, 6)
_Z90 = (2, 3, 6, 7, 0, 1, 4, 5)
_Z180 = (6, 7, 4, 5, 2, 3, 0, 1)
_Z270 = (4, 5, 0, 1, 6, 7, 2, 3)
_MIRROR_Z = (1, 0, 3, 2, 5, 4, 7, 6)
_SAME = tuple(range(8))

# Rotations about z for the x and y bits of a pattern; rotations about y and x for a pattern.
_TURN_Z = (0, 0, 2, 0, 3, 3, 2, 1, 1, 0, 1, 3, 1, 2, 0, 0)
_TURN_Y = {16, 19, 28, 32, 35, 44, 48, 55, 59, 61, 62}
_TURN_X = {
    **dict.fromkeys((17, 18, 20, 24, 33, 34, 36, 40, 51, 60), 1),
    **dict.fromkeys((19, 28, 35, 44, 49, 50, 52, 56), 2),
    **dict.fromkeys((53, 54, 57, 58), 3),
}


def _turned(neigh_pattern: int) -> list[int]:
    """Return each child's new index when a pattern is rotated to represent its class."""
    turns = [(_SAME, _Z90, _Z180, _Z270)[_TURN_Z[neigh_pattern & 15]]]
    if neigh_pattern & 48 == 16:
        turns.append(_MIRROR_Z)
    if neigh_pattern in _TURN_Y:
        turns.append(_Y270)
    turns.append((_SAME, _X90, _X270_Y180, _X90_Y180)[_TURN_X.get(neigh_pattern, 0)])
    places = list(range(8))
    for turn in turns:
        places = [turn[place] for place in places]
    return places


def _map_bases(classes: tuple[int, ...]) -> list[list[int]]:
    rows = [list(_MAP_STARTS)]
    for neigh_pattern in range(1, 64):
        nine = classes[neigh_pattern]
        five, three = _CLASSES_5[nine], _CLASSES_3[nine]
        reduced = [max(c - 1, 0) for c in (*[nine] * 4, five, five, three, 1)]
        rows.append([_MAP_STARTS[i] + (reduced[i] << i) + i + 1 for i in range(8)])
    return rows


CODED_CHILD = np.array(
    [
        [_turned(neigh_pattern).index(place) for place in _CODING_ORDER]
        for neigh_pattern in range(64)
    ],
    dtype=np.int64,
)
CTX_MAP_BASE = np.array([_map_bases(_SIBLING_CLASSES), _map_bases(_CLASSES_9)], dtype=np.int64)
"""Offsets into a context map, by three indices.

The indices are: 1 if neighbours outside the parent are known, else 0; neighbour pattern; coded bit.
"""


class Contexts(NamedTuple):
    # See `arithmetic.Encoder`.
    probabilities: NDArray[np.uint16]
    # See `octree.SliceState`.
    ctx_idx_maps: NDArray[np.uint8]


def initial_contexts() -> Contexts:
    probabilities = np.full(_COUNT, HALF, dtype=np.uint16)
    return Contexts(probabilities, np.full(CTX_MAP_COUNT * CTX_MAP_SIZE, 127, dtype=np.uint8))

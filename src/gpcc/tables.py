"""Constant tables of the octree coder (`tables.cpp` of TMC13).

A neighbour pattern is a mask of occupied face neighbours: 1 for x+1, 2 for x-1, 4 for y-1, 8 for
y+1, 16 for z-1, 32 for z+1. A child's index is 4x + 2y + z; an occupancy is a mask of children.
"""

from __future__ import annotations

import numpy as np

# Decrease of an adaptive probability p of a zero after a one, indexed by p >> 8; after a zero, p
# increases by the entry at 255 - (p >> 8).
ADAPTATION = np.array(
    [
        *(0, 2, 5, 8, 11, 15, 20, 24, 29, 35, 41, 47, 53, 60, 67, 74),
        *(82, 89, 97, 106, 114, 123, 132, 141, 150, 160, 170, 180, 190, 201, 211, 222),
        *(233, 244, 256, 267, 279, 291, 303, 315, 327, 340, 353, 366, 379, 392, 405, 419),
        *(433, 447, 461, 475, 489, 504, 518, 533, 548, 563, 578, 593, 609, 624, 640, 656),
        *(672, 688, 705, 721, 738, 754, 771, 788, 805, 822, 840, 857, 875, 892, 910, 928),
        *(946, 964, 983, 1001, 1020, 1038, 1057, 1076, 1095, 1114, 1133, 1153, 1172, 1192),
        *(1211, 1231, 1251, 1271, 1291, 1311, 1332, 1352, 1373, 1393, 1414, 1435, 1456, 1477),
        *(1498, 1520, 1541, 1562, 1584, 1606, 1628, 1649, 1671, 1694, 1716, 1738, 1760, 1783),
        *(1806, 1828, 1851, 1874, 1897, 1920, 1935, 1942, 1949, 1955, 1961, 1968, 1974, 1980),
        *(1985, 1991, 1996, 2001, 2006, 2011, 2016, 2021, 2025, 2029, 2033, 2037, 2040, 2044),
        *(2047, 2050, 2053, 2056, 2058, 2061, 2063, 2065, 2066, 2068, 2069, 2070, 2071, 2072),
        *(2072, 2072, 2072, 2072, 2072, 2071, 2070, 2069, 2068, 2066, 2065, 2063, 2060, 2058),
        *(2055, 2052, 2049, 2045, 2042, 2038, 2033, 2029, 2024, 2019, 2013, 2008, 2002, 1996),
        *(1989, 1982, 1975, 1968, 1960, 1952, 1943, 1934, 1925, 1916, 1906, 1896, 1885, 1874),
        *(1863, 1851, 1839, 1827, 1814, 1800, 1786, 1772, 1757, 1742, 1727, 1710, 1694, 1676),
        *(1659, 1640, 1622, 1602, 1582, 1561, 1540, 1518, 1495, 1471, 1447, 1422, 1396, 1369),
        *(1341, 1312, 1282, 1251, 1219, 1186, 1151, 1114, 1077, 1037, 995, 952, 906, 857),
        *(805, 750, 690, 625, 553, 471, 376, 255),
    ],
    dtype=np.uint16,
)

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
    """Return each child's new index if a pattern is rotated to the representative of the class."""
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
"""Offsets into a context map.

Indices: 1 if neighbours outside the parent are known; neighbour pattern; coded bit.
"""

POPCOUNT = np.array([bin(i).count("1") for i in range(256)], dtype=np.int64)

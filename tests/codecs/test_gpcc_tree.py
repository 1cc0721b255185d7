"""The octree and what is known of its nodes' neighbours, against sets of positions."""

from itertools import product
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from puckbench.codecs.gpcc.neighbours import (
    adjacent_children,
    atlas,
    enter_cube,
    face_neighbours,
    face_pattern,
    neighbour_grid,
    predicted_children,
)
from puckbench.codecs.gpcc.tree import (
    build_tree,
    leaf_codes,
    leaf_starts,
    node_bits,
    split_axes,
)
from puckbench.geometry.morton import below, coordinates, spread

BITS = st.tuples(*[st.integers(1, 21)] * 3)


def test_a_cube_is_split_along_all_axes() -> None:
    assert split_axes((3, 1, 2), qtbt=False) == [7, 7, 7]


@pytest.mark.parametrize(
    ("bits", "before", "least", "levels"),
    [
        ((4, 2, 2), 4, 0, [4, 4, 7, 7]),
        ((4, 2, 2), 1, 0, [4, 7, 7, 4]),
        ((3, 3, 1), 0, 0, [7, 6, 6]),
        ((3, 3, 1), 0, 1, [6, 6, 7]),
    ],
)
def test_boxes_are_split_along_their_longest_sides(
    bits: Any, before: int, least: int, levels: list[int]
) -> None:
    assert split_axes(bits, True, before, least) == levels


@given(BITS, st.integers(0, 8), st.integers(0, 4))
def test_every_bit_is_split_once(bits: Any, before: int, least: int) -> None:
    sizes = node_bits(split_axes(bits, True, before, least))
    assert sizes[0] == bits
    assert sizes[-1] == (0, 0, 0)


def _cloud(seed: int, bits: tuple[int, int, int], points: int = 200) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.column_stack([random.integers(0, 1 << b, points) for b in bits])


CLOUDS = st.tuples(st.integers(0, 99), st.tuples(*[st.integers(1, 6)] * 3), st.booleans())


@settings(max_examples=40, deadline=None)
@given(CLOUDS)
def test_occupancies_lead_to_the_points(cloud: Any) -> None:
    seed, bits, qtbt = cloud
    points = _cloud(seed, bits)
    levels = split_axes(bits, qtbt)
    tree = build_tree(points, np.zeros(3, dtype=np.int64), levels)
    nodes = [(0, 0, 0)]
    for axes, level in zip(levels, tree.levels, strict=True):
        moves = (axes >> 2 & 1, axes >> 1 & 1, axes & 1)
        nodes = [
            tuple((p << m) + (k >> s & 1) for p, m, s in zip(node, moves, (2, 1, 0), strict=True))
            for node, occupancy in zip(nodes, level.occupancy, strict=True)
            for k in range(8)
            if occupancy >> k & 1
        ]
    assert sorted(nodes) == sorted(set(map(tuple, points.tolist())))
    assert tree.counts.sum() == len(points)
    codes = leaf_codes(tree, levels)
    found = coordinates(codes, np.arange(3), np.zeros(3, dtype=np.int64))
    assert [tuple(p) for p in found.tolist()] == nodes


def test_first_leaves_are_those_below_a_node() -> None:
    tree = build_tree(_cloud(1, (4, 4, 4)), np.zeros(3, dtype=np.int64), [7] * 4)
    starts = leaf_starts(tree)
    assert starts[0].tolist() == [0, len(tree.keys)]
    for depth, of_level in enumerate(starts):
        nodes = tree.keys[of_level[:-1]] >> 3 * (4 - depth)
        assert len(np.unique(nodes)) == len(tree.levels[depth].occupancy)


@numba.njit
def _surroundings(
    parents: np.ndarray, occupancy: np.ndarray, axes: int, cubes: Any, wanted: int
) -> Any:
    """For each child of the parents: code, face pattern, and the prediction of its children."""
    rows = np.zeros((8 * len(parents), 4), dtype=np.int64)
    count, start, end = 0, 0, 0
    for p in range(len(parents)):
        if p == end:
            end = enter_cube(cubes, parents, occupancy, axes, start, p)
            start = p
        base = below(parents[p], axes)
        faces = face_neighbours(cubes, axes, base, np.int64(occupancy[p]))
        grid = neighbour_grid(cubes, axes, base)
        for child in range(8):
            if occupancy[p] >> child & 1:
                foretold, expected = predicted_children(grid, child)
                rows[count, 0] = base | child
                rows[count, 1] = face_pattern(faces, child)
                rows[count, 2] = foretold
                rows[count, 3] = expected
                count += 1
    enter_cube(cubes, parents, occupancy, axes, start, len(parents))
    return rows[:count]


FACES = ((1, 0, 0), (-1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1))


def _expected_row(position: tuple[int, ...], occupied: set[Any], side: int) -> tuple[int, ...]:
    def seen(step: tuple[int, ...]) -> bool:
        other = tuple(p + s for p, s in zip(position, step, strict=True))
        same_cube = all(p >> side == o >> side for p, o in zip(position, other, strict=True))
        return same_cube and other in occupied

    around = [s for s in product((-1, 0, 1), repeat=3) if s != (0, 0, 0) and seen(s)]
    foretold = expected = 0
    for k in range(8):
        towards = [2 * (k >> shift & 1) - 1 for shift in (2, 1, 0)]
        near = sum(all(a in (0, t) for a, t in zip(s, towards, strict=True)) for s in around)
        full = near >= (4 if len(around) < 14 else 5)
        foretold |= (near <= 2 or full) << k
        expected |= full << k
    return sum(seen(f) << i for i, f in enumerate(FACES)), foretold, expected


@pytest.mark.parametrize(("axes", "side"), [(7, 2), (7, 4), (7, 8), (6, 3), (1, 4), (4, 2)])
def test_neighbours_are_those_in_the_same_cube(axes: int, side: int) -> None:
    random = np.random.default_rng(axes + side)
    bits = [4 - (axes >> s & 1) for s in (2, 1, 0)]
    positions = sorted(
        {tuple(random.integers(0, 1 << b) for b in bits) for _ in range(300)}, key=_code
    )
    parents = np.array([_code(p) for p in positions], dtype=np.int64)
    allowed = [k for k in range(8) if k & ~axes == 0]
    chosen = [random.permutation(allowed)[: random.integers(1, len(allowed) + 1)] for _ in parents]
    occupancy = np.array([sum(1 << int(k) for k in ks) for ks in chosen], dtype=np.uint8)
    rows = _surroundings(parents, occupancy, axes, atlas(side), 0)
    found = coordinates(rows[:, 0], np.arange(3), np.zeros(3, dtype=np.int64)).tolist()
    occupied = set(map(tuple, found))
    for position, row in zip(found, rows[:, 1:].tolist(), strict=True):
        assert tuple(row) == _expected_row(tuple(position), occupied, side)


def _code(position: Any) -> int:
    return sum(
        (int(v) >> bit & 1) << (3 * bit + 2 - axis)
        for axis, v in enumerate(position)
        for bit in range(21)
    )


@numba.njit
def _adjacent(cubes: Any, axes: int, node: int, pattern: int) -> Any:
    return adjacent_children(cubes, axes, node, pattern)


@numba.njit
def _spread(bits: int) -> int:
    return spread(bits)


def test_adjacent_children_refine_the_pattern() -> None:
    cubes = atlas(3)
    node = _code((2, 2, 2))
    cubes.nodes[_code((1, 2, 2))] = 0b1001_0110
    cubes.nodes[_code((2, 1, 2))] = 0b0011_0011
    cubes.nodes[_code((2, 2, 1))] = 0b1000_0010
    pattern, one, two, empty, seen = _adjacent(cubes, 7, node, 2 | 4 | 16 | 1)
    assert pattern == 2 | 16 | 1, "the neighbour y-1 has no children on this side"
    assert one == 0b1001 | 0b0100_0001
    assert two == 0b0001
    assert empty == 0b0110 | 0b0011_0011 | 0b0001_0100
    assert seen == 0b1001_0110 | 0b0011_0011 << 8 | 0b1000_0010 << 16


@given(st.integers(0, 2**21 - 1))
def test_bits_are_spread_to_every_third_place(value: int) -> None:
    assert _spread(value) == sum((value >> k & 1) << 3 * k for k in range(21))

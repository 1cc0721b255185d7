"""The octree and what is known of its nodes' neighbours, against sets of positions."""

from itertools import product
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcc.neighbours import (
    empty_atlas,
    face_neighbours,
    neigh_pattern_of,
    neighbour_grid,
    predict_occupancy,
    refine_by_adjacent_children,
    update_atlas,
)
from gpcc.tree import build_tree, coded_axes, leaf_codes, leaf_starts, node_sizes_log2
from pointkit.geometry.morton import first_child_code, morton_points, spread_bits

BITS = st.tuples(*[st.integers(1, 21)] * 3)


def test_a_cube_is_split_along_all_axes() -> None:
    assert coded_axes((3, 1, 2), qtbt=False) == [7, 7, 7]


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
    assert coded_axes(bits, True, before, least) == levels


@given(BITS, st.integers(0, 8), st.integers(0, 4))
def test_every_bit_is_split_once(bits: Any, before: int, least: int) -> None:
    sizes = node_sizes_log2(coded_axes(bits, True, before, least))
    assert sizes[0] == bits
    assert sizes[-1] == (0, 0, 0)


def _cloud(seed: int, bits: tuple[int, int, int], points: int = 200) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.column_stack([random.integers(0, 1 << b, points) for b in bits])


CLOUDS = st.tuples(st.integers(0, 99), st.tuples(*[st.integers(1, 6)] * 3), st.booleans())


@settings(max_examples=40)
@given(CLOUDS)
def test_the_octrees_occupancies_describe_the_points(cloud: Any) -> None:
    seed, bits, qtbt = cloud
    points = _cloud(seed, bits)
    levels = coded_axes(bits, qtbt)
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
    result = morton_points(codes, np.arange(3), np.zeros(3, dtype=np.int64))
    assert [tuple(p) for p in result.tolist()] == nodes


def test_leaf_starts_index_the_first_leaf_of_each_node() -> None:
    tree = build_tree(_cloud(1, (4, 4, 4)), np.zeros(3, dtype=np.int64), [7] * 4)
    starts = leaf_starts(tree)
    assert starts[0].tolist() == [0, len(tree.keys)]
    for depth, of_level in enumerate(starts):
        nodes = tree.keys[of_level[:-1]] >> 3 * (4 - depth)
        assert len(np.unique(nodes)) == len(tree.levels[depth].occupancy)


@numba.njit
def _surroundings(
    parents: np.ndarray, occupancy: np.ndarray, axes: int, atlas: Any, wanted: int
) -> Any:
    """For each child of the parents: code, face pattern, and the prediction of its children."""
    rows = np.zeros((8 * len(parents), 4), dtype=np.int64)
    count, start, end = 0, 0, 0
    for p in range(len(parents)):
        if p == end:
            end = update_atlas(atlas, parents, occupancy, axes, start, p)
            start = p
        base = first_child_code(parents[p], axes)
        faces = face_neighbours(atlas, axes, base, np.int64(occupancy[p]))
        grid = neighbour_grid(atlas, axes, base)
        for child in range(8):
            if occupancy[p] >> child & 1:
                foretold, expected = predict_occupancy(grid, child)
                rows[count, 0] = base | child
                rows[count, 1] = neigh_pattern_of(faces, child)
                rows[count, 2] = foretold
                rows[count, 3] = expected
                count += 1
    update_atlas(atlas, parents, occupancy, axes, start, len(parents))
    return rows[:count]


FACES = ((1, 0, 0), (-1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1))


def _expected_row(position: tuple[int, ...], occupied: set[Any], side: int) -> tuple[int, ...]:
    def adjacent_occupancies(step: tuple[int, ...]) -> bool:
        other = tuple(p + s for p, s in zip(position, step, strict=True))
        same_cube = all(p >> side == o >> side for p, o in zip(position, other, strict=True))
        return same_cube and other in occupied

    around = [
        s for s in product((-1, 0, 1), repeat=3) if s != (0, 0, 0) and adjacent_occupancies(s)
    ]
    foretold = expected = 0
    for k in range(8):
        towards = [2 * (k >> shift & 1) - 1 for shift in (2, 1, 0)]
        near = sum(all(a in (0, t) for a, t in zip(s, towards, strict=True)) for s in around)
        full = near >= (4 if len(around) < 14 else 5)
        foretold |= (near <= 2 or full) << k
        expected |= full << k
    return sum(adjacent_occupancies(f) << i for i, f in enumerate(FACES)), foretold, expected


@pytest.mark.parametrize(("axes", "side"), [(7, 2), (7, 4), (7, 8), (6, 3), (1, 4), (4, 2)])
def test_neighbours_are_those_within_the_atlas_cube(axes: int, side: int) -> None:
    random = np.random.default_rng(axes + side)
    bits = [4 - (axes >> s & 1) for s in (2, 1, 0)]
    positions = sorted(
        {tuple(random.integers(0, 1 << b) for b in bits) for _ in range(300)}, key=_code
    )
    parents = np.array([_code(p) for p in positions], dtype=np.int64)
    allowed = [k for k in range(8) if k & ~axes == 0]
    chosen = [random.permutation(allowed)[: random.integers(1, len(allowed) + 1)] for _ in parents]
    occupancy = np.array([sum(1 << int(k) for k in ks) for ks in chosen], dtype=np.uint8)
    rows = _surroundings(parents, occupancy, axes, empty_atlas(side), 0)
    result = morton_points(rows[:, 0], np.arange(3), np.zeros(3, dtype=np.int64)).tolist()
    occupied = set(map(tuple, result))
    for position, row in zip(result, rows[:, 1:].tolist(), strict=True):
        assert tuple(row) == _expected_row(tuple(position), occupied, side)


def _code(position: Any) -> int:
    return sum(
        (int(v) >> bit & 1) << (3 * bit + 2 - axis)
        for axis, v in enumerate(position)
        for bit in range(21)
    )


@numba.njit
def _adjacent(atlas: Any, axes: int, node: int, neigh_pattern: int) -> Any:
    return refine_by_adjacent_children(atlas, axes, node, neigh_pattern)


@numba.njit
def _spread(bits: int) -> int:
    return spread_bits(bits)


def test_adjacent_children_refine_the_neighbour_pattern() -> None:
    atlas = empty_atlas(3)
    node = _code((2, 2, 2))
    atlas.nodes[_code((1, 2, 2))] = 0b1001_0110
    atlas.nodes[_code((2, 1, 2))] = 0b0011_0011
    atlas.nodes[_code((2, 2, 1))] = 0b1000_0010
    neigh_pattern, gt0, gt1, unocc, occupancies = _adjacent(atlas, 7, node, 2 | 4 | 16 | 1)
    assert neigh_pattern == 2 | 16 | 1, "the neighbour y-1 has no children on this side"
    assert gt0 == 0b1001 | 0b0100_0001
    assert gt1 == 0b0001
    assert unocc == 0b0110 | 0b0011_0011 | 0b0001_0100
    assert occupancies == 0b1001_0110 | 0b0011_0011 << 8 | 0b1000_0010 << 16


@given(st.integers(0, 2**21 - 1))
def test_bits_are_spread_to_every_third_place(value: int) -> None:
    assert _spread(value) == sum((value >> k & 1) << 3 * k for k in range(21))

"""Dual-tree search compared with the distances of all pairs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.geometry.box_tree import LEAF_SIZE, BoxTree, box_tree
from pointkit.geometry.cloud import Floats
from pointkit.seeding import generator
from puckbench.geometry import box_search
from puckbench.geometry.box_search import SAME_DISTANCE, NearestTwo, nearest_two


def room(points: int, seed: int = 0) -> Floats:
    """Points near the walls of a cube."""
    random = generator(seed, "room")
    xyz = random.random((points, 3))
    xyz[np.arange(points), random.integers(0, 3, points)] = random.normal(0, 0.01, points)
    return xyz


def grid(points: int, seed: int = 0) -> Floats:
    """Distinct points of a coarse grid in random order, with many ties."""
    random = generator(seed, "grid")
    return random.permutation(np.unique(random.integers(0, 9, (points, 3)), axis=0)).astype(float)


CLOUDS = {
    "room": room(900),
    "another room": room(500, seed=1),
    "grid": grid(400),
    "half a grid": grid(200, seed=1) / 2,
    "crowd with outliers": np.vstack([room(800), [[1e9, -1e9, 1e12], [3e4, 0, 0]]]),
    "nearly equal": 100 + 1e-5 * grid(300),
    "line": np.arange(600.0)[:, None] * [0, 1, 0],
    "one point": np.array([[0.5, 0.5, 0.5]]),
    "far from the origin": room(300) + 1e7,
}


def all_pairs(queries: Floats, points: Floats) -> NearestTwo:
    x, y, z = (queries[:, None, axis] - points[None, :, axis] for axis in range(3))
    squared = x * x + y * y + z * z
    rows = np.argsort(squared, axis=1, kind="stable")
    least = np.take_along_axis(squared, rows, axis=1)
    near = np.diff(least[:, :3], axis=1) < SAME_DISTANCE
    ties = 1 + np.logical_and.accumulate(near, axis=1).sum(axis=1)
    exact = 1 + (least[:, 1:2] == least[:, :1]).sum(axis=1)
    return NearestTwo(least[:, 0], rows[:, :2], ties, exact)


def assert_as_all_pairs(queries: Floats, points: Floats) -> None:
    result, expected = nearest_two(box_tree(queries), box_tree(points)), all_pairs(queries, points)
    np.testing.assert_array_equal(result.squared, expected.squared)
    np.testing.assert_array_equal(result.ties, expected.ties)
    np.testing.assert_array_equal(result.exact, expected.exact)
    for number in range(1, expected.rows.shape[1] + 1):
        ties = expected.ties == number
        np.testing.assert_array_equal(result.rows[ties, :number], expected.rows[ties, :number])


@pytest.mark.parametrize("queries", CLOUDS)
@pytest.mark.parametrize("points", CLOUDS)
def test_nearest_two_and_ties_equal_those_of_all_pairs(queries: str, points: str) -> None:
    assert_as_all_pairs(CLOUDS[queries], CLOUDS[points])


@settings(max_examples=100)
@given(st.integers(1, 150), st.integers(1, 150), st.integers(0, 2**31), st.sampled_from([1, 40]))
def test_small_random_grids(queries: int, points: int, seed: int, cells: int) -> None:
    random = generator(seed, "grids")
    a, b = (np.unique(random.integers(0, 3 * cells, (n, 3)), axis=0) for n in (queries, points))
    assert_as_all_pairs(a / 1.0, random.permutation(b) / 2)


def test_results_do_not_depend_on_the_batch_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    queries, points = box_tree(grid(600)), box_tree(grid(500, seed=2))
    whole = nearest_two(queries, points)
    for leaves in (1, 3):
        monkeypatch.setattr(box_search, "LEAVES_AT_ONCE", leaves)
        parts = nearest_two(queries, points)
        for first, other in zip(whole, parts, strict=True):
            few = whole.ties < 3
            np.testing.assert_array_equal(first[few], other[few])


@pytest.mark.parametrize("name", CLOUDS)
def test_every_point_is_once_in_a_small_leaf_and_in_its_boxes(name: str) -> None:
    tree = box_tree(CLOUDS[name])
    np.testing.assert_array_equal(CLOUDS[name][tree.rows].T, tree.columns)
    assert sorted(tree.rows) == list(range(len(CLOUDS[name])))
    assert tree.largest <= LEAF_SIZE
    leaves = [[tree.starts[leaf], tree.ends[leaf]] for leaf in tree.leaves]
    assert leaves[0][0] == 0
    assert leaves[-1][1] == len(tree.rows)
    assert [end for _, end in leaves[:-1]] == [start for start, _ in leaves[1:]]
    assert max(depths(tree)) == tree.depth
    for node, box in enumerate(tree.boxes):
        points = tree.columns[:, tree.starts[node] : tree.ends[node]]
        np.testing.assert_array_equal(box, [*points.min(axis=1), *points.max(axis=1)])


def depths(tree: BoxTree, node: int = 0) -> list[int]:
    """Nodes from `node` to each leaf below it."""
    children = range(tree.first[node], tree.first[node] + tree.children[node])
    return [1 + depth for child in children for depth in depths(tree, child)] or [1]


def test_equal_points_and_overflowing_distances() -> None:
    equal, far = np.ones((500, 3)), np.array([[1e200, 0, 0], [-1e200, 0, 0], [1e308, 0, 0]])
    assert box_tree(equal).largest == 500
    result = nearest_two(box_tree(far), box_tree(equal))
    assert np.isinf(result.squared).all()
    assert ((result.rows >= 0) & (result.rows < 500)).all()

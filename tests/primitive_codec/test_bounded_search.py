"""Nearest neighbour search with a limit on its work."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pointkit.geometry.box_tree import box_tree
from primitive_codec.bounded_search import nearest_within

RANDOM = np.random.default_rng(5)


def _sphere(count: int) -> np.ndarray:
    points = RANDOM.normal(size=(count, 3))
    return np.asarray(400 * points / np.linalg.norm(points, axis=1, keepdims=True))


def test_queries_near_a_sphere_need_few_visits_and_at_its_centre_many() -> None:
    sphere, queries = _sphere(20_000), 200
    tree = box_tree(sphere)
    near = sphere[:queries] * 1.001
    centre = RANDOM.normal(size=(queries, 3)) * 1e-9
    assert nearest_within(near, tree, queries * 200)
    assert nearest_within(centre, tree, queries * 15_000) is None
    assert nearest_within(centre, tree, queries * 25_000)


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_results_are_the_nearest_points(scale: float) -> None:
    points, queries = (RANDOM.random((count, 3)) * scale for count in (3_000, 500))
    distances, rows = cKDTree(points / scale).query(queries / scale)
    result = nearest_within(queries, box_tree(points), 1 << 30)
    assert result is not None
    assert np.array_equal(result[1], rows)
    assert np.allclose(result[0] / scale, distances, rtol=1e-12, atol=0)


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_each_of_equal_points_counts_as_a_visit(scale: float) -> None:
    """A leaf of a thousand equal points is visited as a whole."""
    tree = box_tree(np.repeat(_sphere(40), 1000, axis=0) * scale)
    queries = tree.columns[:, ::100].T.copy()
    assert nearest_within(queries, tree, 400 * 1000 - 1) is None
    assert nearest_within(queries, tree, 400 * 2000)

"""Searches that would look at every point are known before they begin."""

import numpy as np
import pytest

from puckbench.geometry.search_work import is_short_search

RANDOM = np.random.default_rng(5)


def _sphere(count: int) -> np.ndarray:
    points = RANDOM.normal(size=(count, 3))
    return np.asarray(400 * points / np.linalg.norm(points, axis=1, keepdims=True))


def test_near_a_sphere_little_is_looked_at_and_at_its_centre_much() -> None:
    sphere, queries = _sphere(20_000), 200
    near = sphere[:queries] * 1.001
    centre = RANDOM.normal(size=(queries, 3)) * 1e-9
    assert is_short_search(near, sphere, queries * 200)
    assert not is_short_search(centre, sphere, queries * 15_000)
    assert is_short_search(centre, sphere, queries * 20_000)


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_equal_points_count_once(scale: float) -> None:
    points = np.repeat(_sphere(40), 1000, axis=0) * scale
    assert is_short_search(points[::100], points, 400 * 60)

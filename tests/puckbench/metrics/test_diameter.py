"""Diameters against closed forms and all pairs."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.distance import cdist, pdist

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.seeding import generator
from puckbench.metrics import diameter as module
from puckbench.metrics.diameter import (
    BLOCK,
    ROUNDING,
    _box_squared,
    _boxes,
    _cap_squared,
    _largest_squared,
    _pairs_squared,
    diameter,
)

POINTS = st.integers(2, 60).flatmap(
    lambda n: arrays(np.float64, (n, 3), elements=st.floats(-1e3, 1e3, width=32))
)


@settings(max_examples=100)
@given(points=POINTS)
def test_diameter_is_the_largest_of_all_pairs(points: Floats) -> None:
    assert diameter(points) == pytest.approx(pdist(points).max(), rel=1e-12)


def unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def triangle_of_clusters(random: np.random.Generator, n: int) -> Floats:
    angle = random.integers(0, 3, n) * 2 * np.pi / 3
    return np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) + random.normal(
        0, 0.05, (n, 3)
    )


SHAPES = {
    "ball": lambda random, n: unit(random.normal(size=(n, 3))) * random.random((n, 1)),
    "sphere": lambda random, n: unit(random.normal(size=(n, 3))),
    "circle": lambda random, n: unit(random.normal(size=(n, 3)) * [1, 1, 0]) + 5,
    "line": lambda random, n: random.random((n, 1)) * [1, 2, 3],
    "grid": lambda random, n: random.integers(0, 8, (n, 3)).astype(float),
    "triangle": triangle_of_clusters,
}


@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_diameter_of_many_points_on_a_shape(shape: str) -> None:
    points = SHAPES[shape](generator(5, shape), 3000)
    assert diameter(points) == pytest.approx(pdist(points).max(), rel=1e-12)


def test_diameter_of_a_million_points_in_a_cube_is_its_diagonal() -> None:
    points = generator(6, "cube").random((1_000_000, 3))
    points[[7, 500_000]] = [[0, 0, 0], [1, 1, 1]]
    assert diameter(points) == 3**0.5


def test_a_single_point_has_no_diameter() -> None:
    assert diameter(np.array([[1.0, 2.0, 3.0]])) == 0
    assert diameter(np.ones((100, 3))) == 0


def test_no_points_are_refused() -> None:
    with pytest.raises(InputError, match="empty"):
        diameter(np.zeros((0, 3)))


def blocks(points: Floats) -> list[Floats]:
    return [points[start : start + BLOCK] for start in range(0, len(points), BLOCK)]


def test_bounds_of_pairs_of_blocks_are_those_of_their_boxes() -> None:
    """Three blocks, of which the last is not full, as numpy has them."""
    points = generator(7, "blocks").normal(size=(150, 3)) * [1, 2, 4] + np.arange(150)[:, None] / 20
    (boxes, diagonals), parts = _boxes(points), blocks(points)
    corners = [
        np.array(list(product(*zip(p.min(axis=0), p.max(axis=0), strict=True)))) for p in parts
    ]
    np.testing.assert_array_equal(boxes, [[p.min(axis=0), p.max(axis=0)] for p in parts])
    for i, j in product(range(3), repeat=2):
        farthest = cdist(parts[i], parts[j]).max() ** 2
        assert _pairs_squared(points, i, j) == pytest.approx(farthest, rel=1e-12)
        assert _box_squared(boxes, i, j) == pytest.approx(cdist(corners[i], corners[j]).max() ** 2)
        across = (diagonals[i] + diagonals[j]) / 2
        cap = _cap_squared(points, boxes, across, i, j)
        assert cap >= farthest * (1 - ROUNDING)
        if i == j:
            continue
        line = unit((boxes[i].mean(axis=0) - boxes[j].mean(axis=0))[None])[0]
        along = (parts[i] @ line).max() - (parts[j] @ line).min()
        across = (pdist(boxes[i])[0] + pdist(boxes[j])[0]) / 2
        assert cap == pytest.approx(along**2 + across**2, rel=1e-11)
        assert cap >= along**2 + across**2


def test_a_small_cloud_has_a_small_diameter() -> None:
    points = generator(7, "blocks").normal(size=(150, 3)) / 1000
    assert _pairs_squared(points, 0, 1) == pytest.approx(
        cdist(points[:64], points[64:128]).max() ** 2
    )
    assert diameter(points) == pytest.approx(pdist(points).max(), rel=1e-12)


def test_a_farther_pair_than_any_other_is_not_looked_for() -> None:
    points = generator(7, "blocks").normal(size=(150, 3))
    assert _largest_squared(points, *_boxes(points), 1e6) == 1e6
    assert _largest_squared(points, *_boxes(points), 0.0) == pytest.approx(pdist(points).max() ** 2)


@pytest.mark.parametrize("count", [1, 64, 65, 150])
def test_no_block_is_looked_at_beyond_the_last(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the loops' own Python, which refuses an index outside of an array."""
    for name in ("_box_squared", "_cap_squared", "_pairs_squared"):
        monkeypatch.setattr(module, name, getattr(module, name).py_func)
    points = generator(8, "blocks").normal(size=(count, 3))
    farthest = cdist(points, points).max() ** 2
    assert _largest_squared.py_func(points, *_boxes(points), 0.0) == pytest.approx(farthest)

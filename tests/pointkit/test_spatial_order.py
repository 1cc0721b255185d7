"""Removal of duplicates and Morton order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pointkit.geometry.cloud import Floats
from pointkit.geometry.spatial_order import distinct_points
from pointkit.seeding import generator

POINTS = st.integers(1, 60).flatmap(
    lambda n: arrays(np.float64, (n, 3), elements=st.sampled_from([-0.0, 0.0, 1.0, 1e-9, -1e6]))
)


@settings(max_examples=100)
@given(points=POINTS)
def test_the_first_of_equal_points_is_kept(points: Floats) -> None:
    firsts = {}
    for row, point in enumerate(points.tolist()):
        firsts.setdefault(tuple(point), row)
    assert sorted(distinct_points(points)[0]) == sorted(firsts.values())


def test_an_outlier_does_not_merge_the_points_of_a_crowded_cell() -> None:
    points = generator(3, "crowd").random((5000, 3))
    points[0] = 1e9
    assert len(distinct_points(np.tile(points, (3, 1)))[0]) == 5000


@pytest.mark.parametrize("extent", [1.0, 1023.0])
def test_corners_of_a_cube_are_visited_in_morton_order(extent: float) -> None:
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]) * extent
    shuffled = generator(4, "corners").permutation(corners)
    np.testing.assert_array_equal(shuffled[distinct_points(shuffled)[0]], corners)

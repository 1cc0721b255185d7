"""Nearest neighbours with their ties, by the rules of MPEG's pc_error."""

from itertools import permutations, product

import numpy as np
import pytest

from puckbench.geometry.neighbours import SearchablePoints, _sort_by_distance

CORNERS = sorted(
    {
        tuple(sign * value for sign, value in zip(signs, order, strict=True))
        for kind in ((1, 4, 8), (4, 4, 7), (3, 6, 6))
        for order in permutations(kind)
        for signs in product((-1.0, 1.0), repeat=3)
    }
)
"""96 points at a distance of 9 from the origin."""


@pytest.mark.parametrize(
    ("equal", "counted"),
    [(1, 10), (9, 10), (10, 15), (14, 15), (25, 30), (29, 30), (30, 30), (40, 40), (96, 96)],
)
def test_near_ties_count_among_the_ten_to_thirty_neighbours_that_pc_error_searches(
    equal: int, counted: int
) -> None:
    """It searches 10 neighbours, 5 more while all of them tie, and 30 at most."""
    nearly = np.array(CORNERS[:20]) * (1 + 1e-12)
    points = np.concatenate([CORNERS[:equal], nearly, [[20.0, 0, 0]]])
    result = SearchablePoints(points).nearest(SearchablePoints(np.zeros((1, 3))))
    assert result.squared.tolist() == [81]
    assert result.exact.tolist() == [equal]
    assert result.starts.tolist() == [0, counted]
    assert set(result.index[:equal]) == set(range(equal))


def test_neighbours_are_sorted_by_their_exact_distances() -> None:
    """Sorting is stable for ties."""
    random = np.random.default_rng(0)
    points, queries = random.integers(0, 9, (40, 3)).astype(float), random.random((5, 3)) * 9
    index = np.array([random.permutation(40) for _ in queries], dtype=np.uint32)
    distances = ((queries[:, None] - points[index]) ** 2).sum(axis=2)
    order = np.argsort(distances, axis=1, kind="stable")
    expected = np.take_along_axis(index, order, axis=1)
    np.testing.assert_allclose(_sort_by_distance(queries, points, index), np.sort(distances))
    np.testing.assert_array_equal(index, expected)

import numpy as np
import pytest

from pointkit.geometry.morton import morton_codes, morton_points


@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 1, 0), (1, 0, 2)])
def test_coordinates_are_the_inverse_of_codes(axes: tuple[int, int, int]) -> None:
    order = np.array(axes)
    points = np.random.default_rng(0).integers(0, 2**21, (200, 3))
    result = morton_codes(points, order)
    assert np.array_equal(morton_points(result, order, np.zeros(3, np.int64)), points)


def test_the_first_axis_has_the_highest_bits() -> None:
    assert morton_codes(np.eye(3, dtype=np.int64), np.arange(3)).tolist() == [4, 2, 1]

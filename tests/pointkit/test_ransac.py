import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.ransac import least_squares_plane, ransac_plane, robust_plane, robust_std

NORMAL, OFFSET = np.array([2.0, -1.0, 2.0]) / 3, 4.0


def plane_points(count: int, sigma: float, outliers: int = 0) -> Floats:
    """Points about a known plane, and outliers that all lie on one side of it."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-2, 2, (count + outliers, 3))
    heights = np.r_[rng.normal(0, sigma, count), rng.uniform(0.1, 3, outliers)]
    return points + np.outer(OFFSET + heights - points @ NORMAL, NORMAL)


@pytest.mark.parametrize("refit", [False, True])
def test_a_known_plane_is_found_among_outliers(refit: bool) -> None:
    points = plane_points(3000, 0.002, outliers=2000)
    plane = ransac_plane(points, np.random.default_rng(1), refit=refit).facing(10 * NORMAL)
    tolerance = 5e-4 if refit else 1e-2
    assert plane.normal == pytest.approx(NORMAL, abs=tolerance)
    assert plane.offset == pytest.approx(OFFSET, abs=tolerance)


def test_without_refit_the_plane_passes_through_three_of_the_points() -> None:
    points = plane_points(500, 0.01)
    distances = ransac_plane(points, np.random.default_rng(1)).distances(points)
    assert np.count_nonzero(np.abs(distances) < 1e-12) == 3


def test_refit_takes_the_least_squares_plane_of_the_inliers() -> None:
    points = plane_points(2000, 0.001, outliers=500)
    plane = ransac_plane(points, np.random.default_rng(1), refit=True).facing(10 * NORMAL)
    best = least_squares_plane(points[:2000]).facing(10 * NORMAL)
    assert plane.normal == pytest.approx(best.normal, abs=1e-12)
    assert plane.offset == pytest.approx(best.offset, abs=1e-12)


def test_distances_are_signed_by_the_side_that_the_plane_faces() -> None:
    points = plane_points(100, 0.0)
    plane = ransac_plane(points, np.random.default_rng(1))
    for place, sign in ((10 * NORMAL, 1), (-10 * NORMAL, -1)):
        lifted = plane.facing(place).distances(points + 0.25 * NORMAL)
        assert lifted == pytest.approx(sign * 0.25, abs=1e-9)


def test_the_same_generator_finds_the_same_plane() -> None:
    points = plane_points(1000, 0.02)
    first, second = (ransac_plane(points, np.random.default_rng(9)) for _ in range(2))
    assert np.array_equal(first.normal, second.normal)
    assert first.offset == second.offset


@pytest.mark.parametrize(
    ("points", "fault"),
    [
        (np.zeros((2, 3)), "at least 3 points, there are 2"),
        (np.outer(np.arange(9.0), [1, 2, 3]), "the 9 points lie on one line"),
        (np.ones((9, 3)), "one line"),
    ],
)
def test_points_without_a_plane_are_refused(points: Floats, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        ransac_plane(points, np.random.default_rng(1))


def test_a_robust_plane_excludes_outliers() -> None:
    points = plane_points(3000, 0.005, outliers=300)
    start = ransac_plane(points, np.random.default_rng(1), threshold_m=0.02)
    plane, near = robust_plane(points, start)
    assert not near[3000:].any()
    # Beyond five standard deviations there is one Gaussian in 1.7 million.
    assert near[:3000].all()
    best = least_squares_plane(points[:3000])
    assert plane.facing(10 * NORMAL).normal == pytest.approx(best.facing(10 * NORMAL).normal)


def test_a_robust_plane_of_points_without_noise_includes_all() -> None:
    points = plane_points(100, 0.0)
    start = ransac_plane(points, np.random.default_rng(1))
    assert robust_plane(points, start)[1].all()


def test_the_robust_standard_deviation_is_that_of_a_gaussian() -> None:
    values = np.random.default_rng(1).normal(3.0, 0.02, 100_000)
    values[:100] = 1e6
    assert robust_std(values) == pytest.approx(0.02, rel=0.02)

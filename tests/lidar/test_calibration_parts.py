"""Parts of a calibration against numpy, scipy and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, uniform

from puckbench.geometry.cloud import Floats
from puckbench.lidar.calibration import kernels
from puckbench.lidar.calibration.fitting import free_parameters, interval
from puckbench.lidar.calibration.likelihood import NAMES, RestrictedLikelihood, Sigmas
from puckbench.lidar.calibration.noise_shape import (
    RayShape,
    _log_gaussian,
    _log_laplace,
    _standard_differences,
    ray_shape,
)
from puckbench.lidar.calibration.observations import Observations, observations
from tests.support.calibration_lookalike import residuals

RANDOM = np.random.default_rng(3)


def test_an_interval_of_95_percent_is_1_96_standard_errors_either_way() -> None:
    found = interval(1.0, 0.5)
    reach = 0.5 * norm.ppf(0.975)
    assert (found.value, found.low, found.high) == pytest.approx((1.0, 1.0 - reach, 1.0 + reach))


def test_differences_of_two_rays_have_the_density_of_their_noise() -> None:
    """Of noises of standard deviation 1: a difference has the variance 2, whatever the shape."""
    step = np.linspace(-40, 40, 400_001)
    np.testing.assert_allclose(_log_gaussian(step), norm(scale=2**0.5).logpdf(step))
    density, width = np.exp(_log_laplace(step)), step[1] - step[0]
    assert density.sum() * width == pytest.approx(1)
    assert (density * step**2).sum() * width == pytest.approx(2)
    laplace = np.exp(-np.abs(step[::20]) * 2**0.5) / 2**0.5
    at_one = (laplace * np.exp(-np.abs(step[::20] - 1) * 2**0.5) / 2**0.5).sum() * 20 * width
    assert np.exp(_log_laplace(np.array([1.0]))) == pytest.approx(at_one, rel=1e-5)


@pytest.mark.parametrize(("kurtosis", "widening"), [(3, 1), (6, 2.5**0.5), (1, 0.5)])
def test_heavy_tails_widen_intervals(kurtosis: float, widening: float) -> None:
    assert RayShape("gaussian", 0.0, kurtosis).widening == pytest.approx(widening)


@pytest.mark.parametrize(("laplace", "kurtosis"), [(False, 3), (True, 6)])
def test_kurtosis_is_that_of_the_rays(laplace: bool, kurtosis: float) -> None:
    seen = observations([residuals(7, ray=(0.006, 0.0, 0.0), laplace=laplace)])
    shape = ray_shape(RestrictedLikelihood(seen), Sigmas(ray_sigma_m=0.006))
    assert shape.kurtosis == pytest.approx(kurtosis, rel=0.2)
    assert (shape.laplace_over_gaussian > 0) == laplace


def seen_of(error: Floats, groups: list[int], ranges: Floats) -> Observations:
    """Returns of groups of one laser, each a cell of its own, before one wall."""
    count, alike = len(error), np.zeros(len(groups) - 1, np.int64)
    features = np.column_stack([np.ones(count), np.zeros(count), ranges])
    codes = (alike, alike, alike, np.arange(len(alike)))
    return Observations(error, np.zeros((count, 3)), features, np.array(groups), *codes, (0,), 1,
                        tells_mean=True)  # fmt: skip


def test_pairs_are_following_returns_of_a_group_in_units_of_their_rays_sigma() -> None:
    error, ranges = RANDOM.normal(size=12), RANDOM.uniform(1, 9, size=12)
    likelihood = RestrictedLikelihood(seen_of(error, [0, 3, 4, 9, 12], ranges))
    found = _standard_differences(likelihood, Sigmas(ray_sigma_m=0.1, ray_range=0.2))
    scale = 0.1 + 0.2 * ranges
    pairs = [(0, 1), (4, 5), (6, 7), (9, 10)]
    expected = [(error[b] - error[a]) / np.hypot(scale[a], scale[b]) * 2**0.5 for a, b in pairs]
    assert found == pytest.approx(np.array(expected))


def of_one_size(difference: float, count: int) -> RayShape:
    """The shape of noise whose following returns differ by so many sigmas, in `count` returns."""
    error = np.where(np.arange(count) % 2 == 0, 0.0, difference)
    seen = seen_of(error, [0, count], np.ones(count))
    return ray_shape(RestrictedLikelihood(seen), Sigmas(ray_sigma_m=1.0))


def test_a_shape_is_told_from_thirty_pairs_on() -> None:
    assert of_one_size(0.1, 59) == RayShape("gaussian", 0.0, 3.0)
    # The fourth moment of differences of one size is the square of the second.
    assert of_one_size(0.1, 60).kurtosis == pytest.approx(2 - 3)


def test_the_likelier_shape_is_taken_however_little_likelier() -> None:
    """Small and large differences are likelier of Laplace noise, those between of Gaussian."""

    def gain(difference: float) -> float:
        scaled = difference * 2**0.5
        laplace = np.log((1 + scaled) * np.exp(-scaled) / 4 * 2**0.5)
        return float(laplace - norm(scale=2**0.5).logpdf(difference))

    border = brentq(gain, 0.0, 2.0)
    for factor, shape in ((0.99, "laplace"), (1.01, "gaussian")):
        found = of_one_size(factor * border, 60)
        assert found.distribution == shape
        assert found.laplace_over_gaussian == pytest.approx(30 * gain(factor * border))
        assert abs(found.laplace_over_gaussian) < 0.5


def test_the_variance_of_a_ray_has_that_of_its_rounding() -> None:
    ranges = np.linspace(1, 9, 5)
    likelihood = RestrictedLikelihood(seen_of(np.zeros(5), [0, 5], ranges), 0.004)
    expected = (0.001 + 0.0002 * ranges) ** 2 + uniform(scale=0.004).var()
    found = likelihood.variances(Sigmas(ray_sigma_m=0.001, ray_range=0.0002))
    assert found == pytest.approx(expected)


def test_noise_that_is_not_named_is_none() -> None:
    assert vars(Sigmas()) == dict.fromkeys(NAMES, 0.0)


def test_the_determinant_and_the_form_are_those_of_numpy() -> None:
    factor = RANDOM.normal(size=(9, 9))
    matrix, right = factor @ factor.T + np.eye(9), RANDOM.normal(size=9)
    determinant, product = kernels.solved(matrix, right)
    assert determinant == pytest.approx(np.linalg.slogdet(matrix)[1])
    assert product == pytest.approx(right @ np.linalg.solve(matrix, right))
    matrix[4] = matrix[:, 4] = 0.0
    assert np.isnan(kernels.solved(matrix, right)).all()


def test_sums_of_groups_are_those_of_their_returns() -> None:
    count, groups = 12, np.array([0, 5, 6, 12])
    errors, basis, features = RANDOM.normal(size=count), *RANDOM.random((2, count, 3))
    sums = np.empty((3, kernels.WIDTH))
    kernels.group_sums(groups, (errors, basis, features), (0.1, 0.3, -0.6), (0.05, 0.01), sums)
    scale = np.maximum(0.1 + 0.3 * features[:, 1] - 0.6 * features[:, 2], 0.05)
    assert 0 < np.count_nonzero(scale == 0.05) < count
    variance = scale**2 + 0.01
    pairs = [basis[:, i] * basis[:, j] for i in range(3) for j in range(i, 3)]
    terms = [np.ones(count), *basis.T, *pairs, errors, *(errors[:, None] * basis).T, errors**2]
    columns = np.column_stack([np.array(terms).T / variance[:, None], np.log(variance)])
    expected = [columns[a:b].sum(axis=0) for a, b in pairwise(groups)]
    np.testing.assert_allclose(sums, expected)


def test_a_cell_leaves_the_equations_by_a_matrix_of_rank_one() -> None:
    """In the loop's own Python, which refuses an index outside of an array."""
    first, last, planes, lasers, scans = 1, 3, 4, 2, 3
    codes = (np.array([0, 1, 1, 2]), np.array([0, 1, 3, 2]))
    columns = (np.full(4, 3 * planes + 1), np.full(4, 3 * planes + lasers + 2))
    sums = RANDOM.random((4, kernels.WIDTH))
    shrunk, weight, product = 0.3, 2.0, 0.7
    size = 3 * planes + lasers + scans
    matrix, right, outer = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    kernels._take_cell.py_func(
        first, last, (*codes, *columns), sums, (shrunk, weight, product), matrix, right
    )
    outer[[3 * planes + 1, 3 * planes + lasers + 2]] = weight
    outer[3:6], outer[9:12] = sums[1, 1:4], sums[2, 1:4]
    np.testing.assert_allclose(matrix, -shrunk * np.outer(outer, outer))
    np.testing.assert_allclose(right, -shrunk * product * outer)


@pytest.mark.parametrize(("lasers", "frames", "free"), [(3, 2, NAMES), (2, 2, NAMES[1:])])
def test_the_spread_of_lasers_needs_three(lasers: int, frames: int, free: tuple[str, ...]) -> None:
    table = residuals(1, frames=frames)
    seen = observations([table[table["laser_id"] < lasers]])
    assert free_parameters(seen) == free


def test_biases_of_scans_and_frames_need_several() -> None:
    table = residuals(1, frames=2)
    one_scan = observations([table[table["distance_m"] == table["distance_m"].min()]])
    without = free_parameters(one_scan, [name for name in NAMES if name != "ray_range"])
    assert "scan_sigma_m" not in without
    assert "frame_sigma_m" in without
    one_frame = observations([table[table["frame"] == 0]])
    assert "frame_sigma_m" not in free_parameters(one_frame)
    assert free_parameters(one_frame, ["laser_sigma_m"]) == ("laser_sigma_m", "ray_sigma_m")

"""Parts of a calibration against numpy, scipy and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import norm

from puckbench.lidar.calibration import kernels
from puckbench.lidar.calibration.fitting import free_parameters, interval
from puckbench.lidar.calibration.likelihood import NAMES, RestrictedLikelihood, Sigmas
from puckbench.lidar.calibration.noise_shape import (
    RayShape,
    _log_gaussian,
    _log_laplace,
    ray_shape,
)
from puckbench.lidar.calibration.observations import observations
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

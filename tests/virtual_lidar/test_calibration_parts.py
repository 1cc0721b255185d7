"""Parts of a calibration against numpy, scipy and closed forms."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, uniform

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from tests.support.calibration_lookalike import residuals
from virtual_lidar.calibration import kernels
from virtual_lidar.calibration.calibrating import (
    RayShape,
    _log_gaussian,
    _log_laplace,
    _standard_differences,
    ray_shape,
)
from virtual_lidar.calibration.fitting import free_parameters, interval
from virtual_lidar.calibration.likelihood import NAMES, RestrictedLikelihood, Sigmas
from virtual_lidar.calibration.observations import (
    Observations,
    _beyond_regressed_plane,
    _heights,
    observations,
)

RANDOM = np.random.default_rng(3)


def test_an_interval_of_95_percent_is_1_96_standard_errors_either_way() -> None:
    result = interval(1.0, 0.5)
    reach = 0.5 * norm.ppf(0.975)
    assert (result.value, result.low, result.high) == pytest.approx((1.0, 1.0 - reach, 1.0 + reach))


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
    result = _standard_differences(likelihood, Sigmas(ray_sigma_m=0.1, ray_range=0.2))
    scale = 0.1 + 0.2 * ranges
    pairs = [(0, 1), (4, 5), (6, 7), (9, 10)]
    expected = [(error[b] - error[a]) / np.hypot(scale[a], scale[b]) * 2**0.5 for a, b in pairs]
    assert result == pytest.approx(np.array(expected))


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
        result = of_one_size(factor * border, 60)
        assert result.distribution == shape
        assert result.laplace_over_gaussian == pytest.approx(30 * gain(factor * border))
        assert abs(result.laplace_over_gaussian) < 0.5


def test_the_variance_of_a_ray_has_that_of_its_rounding() -> None:
    ranges = np.linspace(1, 9, 5)
    likelihood = RestrictedLikelihood(seen_of(np.zeros(5), [0, 5], ranges), 0.004)
    expected = (0.001 + 0.0002 * ranges) ** 2 + uniform(scale=0.004).var()
    result = likelihood.variances(Sigmas(ray_sigma_m=0.001, ray_range=0.0002))
    assert result == pytest.approx(expected)


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
        first,
        last,
        kernels.Columns(*codes, *columns),
        sums,
        (shrunk, weight, product),
        matrix,
        right,
    )
    outer[[3 * planes + 1, 3 * planes + lasers + 2]] = weight
    outer[3:6], outer[9:12] = sums[1, 1:4], sums[2, 1:4]
    np.testing.assert_allclose(matrix, -shrunk * np.outer(outer, outer))
    np.testing.assert_allclose(right, -shrunk * product * outer)


def test_equations_without_cells_are_those_of_the_whole_covariance() -> None:
    """In the loop's own Python: three surfaces, two lasers in two scans each, four cells."""
    groups = np.array([0, 4, 6, 11, 13, 18, 20])
    cell, surface = np.array([0, 0, 1, 2, 2, 3]), np.array([0, 1, 1, 0, 2, 2])
    laser, scan = np.array([0, 0, 1, 0, 0, 1]), np.array([0, 0, 1, 2, 2, 3])
    codes = kernels.Columns(cell, surface, 9 + laser, 11 + scan)
    count = np.diff(groups)
    errors, basis = RANDOM.normal(size=20), RANDOM.random((20, 3))
    features = np.column_stack([np.ones(20), *RANDOM.random((2, 20))])
    sums = np.empty((6, kernels.WIDTH))
    kernels.group_sums(groups, (errors, basis, features), (0.1, 0.2, 0.3), (1e-6, 0.0), sums)
    design = np.zeros((20, 15))
    for row, group in enumerate(np.repeat(np.arange(6), count)):
        design[row, 3 * surface[group] + np.arange(3)] = basis[row]
        design[row, [codes.laser[group], codes.scan[group]]] = 1.0
    rays = (features @ [0.1, 0.2, 0.3]) ** 2
    of = np.repeat(cell, count)
    inverse = np.linalg.inv(np.diag(rays) + 0.05 * (of[:, None] == of))
    matrix, right = np.zeros((15, 15)), np.zeros(15)
    taken, added = kernels.eliminate_cell_biases.py_func(codes, sums, 0.05, matrix, right)
    np.testing.assert_allclose(matrix, design.T @ inverse @ design, atol=1e-9)
    np.testing.assert_allclose(right, design.T @ inverse @ errors, atol=1e-9)
    assert (errors**2 / rays).sum() - taken == pytest.approx(errors @ inverse @ errors)
    logarithm = -np.linalg.slogdet(inverse)[1]
    assert np.log(rays).sum() + added == pytest.approx(logarithm)


def test_errors_are_along_the_rays_beyond_a_plane_that_may_be_askew() -> None:
    normal = np.array([0.2, -0.3, -1.0])
    normal /= np.linalg.norm(normal)
    rays = np.column_stack([*RANDOM.uniform(-0.5, 0.5, (2, 50)), np.full(50, -1.0)])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    far = 3.0 / (rays @ normal)
    error, met, cosine, *basis = _beyond_regressed_plane(rays * far[:, None]).T
    assert error == pytest.approx(np.zeros(50), abs=1e-12)
    assert met == pytest.approx(far)
    assert cosine == pytest.approx(rays @ normal)
    np.testing.assert_allclose(np.array(basis).T, far[:, None] ** 2 * rays)


def test_the_height_over_a_plane_is_that_of_pythagoras_in_the_median_of_its_points() -> None:
    """Of each of two planes a fifth of the ranges are wrong, some shorter than the way along it."""
    random = np.random.default_rng(5)
    height = np.repeat([2.5, 4.0], 25)
    u, v = random.uniform(-6, 6, (2, 50))
    residual = random.normal(0, 0.01, 50)
    ranges = np.sqrt((height - residual) ** 2 + u**2 + v**2)
    ranges[::5] /= np.repeat([2, 100], 5)
    table = pd.DataFrame({"range_m": ranges, "plane_u_m": u, "plane_v_m": v})
    table = table.assign(device=0, distance_m=1.0, surface="wall", residual_m=residual)
    assert _heights(table.assign(run=np.repeat([1, 2], 25))) == pytest.approx(height)


def wall_table(azimuth: Floats) -> pd.DataFrame:
    """Residuals of a wall 1 m away, met without an error at these azimuths."""
    count = len(azimuth)
    return pd.DataFrame(
        {
            "distance_m": 1.0,
            "surface": "wall",
            "run": 1,
            "laser_id": np.arange(count) % 8,
            "residual_m": 0.0,
            "incidence_rad": np.abs(azimuth),
            "range_m": np.hypot(1 / np.cos(azimuth), np.arange(count) % 8 / 10),
            "frame": 0,
            "plane_u_m": np.tan(azimuth),
            "plane_v_m": np.arange(count) % 8 / 10,
        }
    )


def test_rays_that_graze_a_surface_tell_nothing_of_the_range() -> None:
    """Those whose incidence has a cosine of less than 0.05."""
    azimuth = np.append(np.linspace(-0.6, 0.6, 120), np.arccos([0.055, 0.045]))
    assert len(observations([wall_table(azimuth)])) == 121


def test_a_hundred_residuals_are_enough_and_fewer_are_not() -> None:
    assert len(observations([wall_table(np.linspace(-0.6, 0.6, 100))])) == 100
    with pytest.raises(InputError, match="at least 100 residuals, there are 99"):
        observations([wall_table(np.linspace(-0.6, 0.6, 99))])


def test_planes_scans_and_cells_are_counted_over_devices() -> None:
    """Two devices before a wall each, whose eight lasers measure in three frames."""
    table = wall_table(np.linspace(-0.6, 0.6, 240))
    seen = observations([table.assign(frame=np.arange(240) // 8 % 3)] * 2)
    assert (seen.devices, seen.surfaces, seen.scans, seen.cells) == (2, 2, 16, 48)
    assert (len(seen), seen.laser_ids) == (480, (*range(8), *range(8)))


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

import numpy as np
import pytest
from scipy.stats import chi2

from pointkit.geometry.cloud import Floats
from pointkit.geometry.ransac import Plane
from pointkit.lidar.return_table import ReturnTable
from tests.support.room_captures import STEP_DEG, captured, room_scan
from virtual_lidar.walls.detection import DetectedPlane
from virtual_lidar.walls.statistics import (
    LaserBias,
    PlaneStatistics,
    RayNoise,
    azimuth_step,
    laser_bias,
    range_deviation,
    ray_noise,
    repeatability,
)

SIGMA_M, STEP_RAD = 0.0063, np.radians(0.2)


def repeated(turns: int, columns: int = 1800) -> dict[str, Floats]:
    """Deviations of 16 lasers with biases, over turns whose azimuths are not quite the same."""
    rng = np.random.default_rng(3)
    turn, laser, column = (part.ravel() for part in np.indices((turns, 16, columns)))
    bias, wall = rng.normal(0, 0.01, 16), 0.02 * np.sin(column / 100)
    noise = rng.normal(0, SIGMA_M, len(turn))
    azimuth = (column + rng.uniform(-0.4, 0.4, len(turn))) * STEP_RAD
    deviation = bias[laser] + wall + noise
    return {"deviation": deviation, "laser": laser, "azimuth": azimuth, "turn": turn}


@pytest.mark.parametrize("turns", [3, 4, 10])
def test_ray_noise_is_what_changes_from_turn_to_turn(turns: int) -> None:
    noise = ray_noise(**repeated(turns), step_rad=STEP_RAD)
    assert noise is not None
    assert noise.bins == 16 * 1800
    assert noise.sigma_m == pytest.approx(SIGMA_M, rel=0.01)
    # The variance of n Gaussians is distributed as chi squared with n - 1 degrees of freedom.
    low = np.sqrt(chi2.median(turns - 1) / (turns - 1))
    assert noise.median_std_m == pytest.approx(low * SIGMA_M, rel=0.015)


def test_a_few_returns_that_jump_hardly_move_the_median() -> None:
    values = repeated(4)
    values["deviation"][::97] += 0.5
    noise = ray_noise(**values, step_rad=STEP_RAD)
    assert noise is not None
    assert noise.median_std_m == pytest.approx(0.888 * SIGMA_M, rel=0.06)


def test_two_turns_are_too_few() -> None:
    assert ray_noise(**repeated(2, 50), step_rad=STEP_RAD) is None
    assert ray_noise(**repeated(4, 50), step_rad=np.nan) is None


def test_two_returns_of_one_turn_are_no_repetition() -> None:
    values = repeated(3, 50)
    values["turn"] = np.where(values["turn"] == 2, 1, values["turn"])
    assert ray_noise(**values, step_rad=STEP_RAD) is None


def test_a_return_beyond_the_plane_deviates_by_its_depth_along_the_ray() -> None:
    deviation = range_deviation(np.array([-0.01, 0.01]), np.radians([60.0, 0.0]))
    assert deviation == pytest.approx([0.02, -0.01])


def test_the_bias_of_a_laser_is_its_mean() -> None:
    laser = np.repeat([0, 3, 7], [100, 200, 5])
    bias = laser_bias(np.array([0.01, -0.02, 9.0])[np.searchsorted([0, 3, 7], laser)], laser)
    assert bias.lasers.tolist() == [0, 3]
    assert bias.mean_m == pytest.approx([0.01, -0.02])
    assert bias.returns.tolist() == [100, 200]
    assert bias.std_m == pytest.approx(0.03 / np.sqrt(2))


def test_twenty_returns_tell_a_bias() -> None:
    laser = np.repeat([0, 1, 2], [20, 19, 21])
    assert laser_bias(np.zeros(60), laser).lasers.tolist() == [0, 2]


def test_one_laser_has_no_spread() -> None:
    assert laser_bias(np.zeros(50), np.zeros(50, dtype=int)).std_m is None


def walls(shared: float, own: float, count: int = 60) -> list[LaserBias]:
    """Biases of 16 lasers on walls: a part that a laser keeps, and one of its own on each."""
    rng = np.random.default_rng(1)
    kept, lasers = rng.normal(0, 1, 16), np.arange(16)
    kept *= shared / kept.std(ddof=1)
    return [
        LaserBias(lasers, kept + rng.normal(0, own, 16), np.full(16, 100)) for _ in range(count)
    ]


def test_repeatability_tells_the_part_that_a_laser_keeps() -> None:
    result = repeatability(walls(0.006, 0.004))
    assert result is not None
    assert result.pairs == 60 * 59 / 2
    assert result.shared_std_m == pytest.approx(0.006, rel=0.03)
    assert result.correlation == pytest.approx(36 / (36 + 16), abs=0.03)


def test_biases_that_do_not_repeat_share_nothing() -> None:
    result = repeatability(walls(1e-9, 0.004))
    assert result is not None
    assert result.correlation == pytest.approx(0, abs=0.02)
    assert result.shared_std_m < 0.0008


def test_repeatability_of_two_walls_is_their_correlation() -> None:
    """Over the six lasers that both have, in whatever order of planes."""
    first, other = walls(0.006, 0.004, 2)
    few = LaserBias(other.lasers[10:], other.mean_m[10:], other.returns[10:])
    covariance = np.cov(first.mean_m[10:], few.mean_m)
    result = repeatability([first, few])
    assert result is not None
    assert result.pairs == 1
    assert result.correlation == pytest.approx(np.corrcoef(first.mean_m[10:], few.mean_m)[0, 1])
    assert result.shared_std_m == pytest.approx(np.sqrt(max(covariance[0, 1], 0)))
    opposed = repeatability([first, LaserBias(first.lasers, -first.mean_m, first.returns)])
    assert opposed is not None
    assert (opposed.correlation, opposed.shared_std_m) == (pytest.approx(-1), 0)


def test_repeatability_needs_two_walls_with_six_lasers_in_common() -> None:
    first, other = walls(0.006, 0.0, 2)
    few = LaserBias(other.lasers[:5], other.mean_m[:5], other.returns[:5])
    assert repeatability([first]) is None
    assert repeatability([first, few]) is None


def test_the_step_of_azimuth_is_that_of_the_scan() -> None:
    table = captured(room_scan(2))
    assert np.degrees(azimuth_step(table)) == pytest.approx(STEP_DEG)
    assert np.isnan(azimuth_step(table.select(np.arange(16))))


def test_two_returns_of_one_firing_are_no_step() -> None:
    azimuth = np.repeat(np.radians([10.0, 10.2, 10.4]), 3)
    nothing = np.zeros(9, dtype=int)
    columns = {"azimuth": azimuth, "laser_id": nothing, "turn": nothing}
    assert np.degrees(azimuth_step(ReturnTable(columns))) == pytest.approx(0.2)


# Forty, sixty and five returns of three lasers, from a wall that is 5 mm off to either side.
LASER = np.repeat([0, 3, 7], [40, 60, 5])
DEVIATION = np.where(np.arange(105) % 2, 0.005, -0.005) + np.repeat([0.01, -0.02, 1.0], [40, 60, 5])


def seen(some: slice, noise_m: float | None) -> PlaneStatistics:
    """Some of these returns as a plane's, with so much noise of single rays."""
    laser, deviation = LASER[some], DEVIATION[some]
    surface = DetectedPlane(
        "wall", Plane(np.array([0.0, -1.0, 0.0]), -2.5), np.arange(105)[some], 3, 1
    )
    rows = ReturnTable({"laser_id": laser, "distance": np.full(len(laser), 2.5)})
    noise = None if noise_m is None else RayNoise(0.9, noise_m, 1)
    bias = laser_bias(deviation, laser)
    return PlaneStatistics(surface, rows, -deviation, deviation, bias, noise)


def test_unevenness_is_what_biases_and_rays_leave_of_the_spread() -> None:
    """Variances are subtracted; a laser with fewer than twenty returns has no bias to tell."""
    assert seen(slice(None), 0.003).unevenness_m == pytest.approx(0.004)
    assert seen(slice(None), 0.006).unevenness_m == 0
    assert seen(slice(None), None).unevenness_m is None
    assert seen(slice(100, None), 0.003).unevenness_m is None


def test_a_plane_is_described_by_its_numbers() -> None:
    result = seen(slice(None), 0.003).described()
    assert (result["distance_m"], result["width_m"], result["height_m"]) == (2.5, 3, 1)
    assert (result["rows"], result["lasers"]) == (105, 3)
    assert result["std_m"] == pytest.approx(np.sqrt(np.cov(DEVIATION)))
    assert result["laser_bias_m"] == {"0": pytest.approx(0.01), "3": pytest.approx(-0.02)}
    assert result["laser_bias_std_m"] == pytest.approx(0.03 / np.sqrt(2))
    assert result["ray_noise"] == {"median_std_m": 0.9, "sigma_m": 0.003, "bins": 1}
    assert seen(slice(None), None).described()["ray_noise"] is None


@pytest.mark.parametrize("changing", ["laser_id", "turn"])
def test_a_step_is_between_firings_of_one_laser_in_one_turn(changing: str) -> None:
    """Three lasers, or turns, of which the last alone fires twice."""
    columns = {name: np.zeros(4, dtype=int) for name in ("laser_id", "turn")}
    columns[changing] = np.array([0, 1, 2, 2])
    azimuth = np.radians([10.0, 20.0, 30.0, 30.2])
    result = azimuth_step(ReturnTable({**columns, "azimuth": azimuth}))
    assert np.degrees(result) == pytest.approx(0.2)

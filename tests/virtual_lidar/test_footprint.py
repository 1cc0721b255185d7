"""Beams with a width, and noise off the ray, against closed forms on walls."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import joined, quad, wall
from virtual_lidar import ScanTable, Sweep, open_error_model, scan
from virtual_lidar.errors import Draws

VLP16 = load_sensor("vlp16")
QUIET = {"bias_sigma_m": 0, "ray_sigma_m": 0}
LEVEL = Sweep(duration_s=0.25, pitch_start_deg=0, pitch_end_deg=0)


def scanned(mesh: Mesh, errors: str, sweep: Sweep = LEVEL, **options: Any) -> ScanTable:
    model = open_error_model(errors, options)
    return scan(mesh, VLP16, sweep, model, [0, 0, 0], np.random.default_rng(2))


def step(behind: float) -> Mesh:
    """A plate at y = 5 that covers x < 0, and a wall farther off."""
    return joined([quad([-50, 5, -50], [50, 0, 0], [0, 0, 100]), wall(5 + behind)])


def across_the_edge(behind: float, **options: Any) -> Floats:
    """Measured depths of beams of which some rays hit the plate and some the wall, (n,)."""
    options = {**QUIET, "yaw_width_deg": 1.0, "pitch_width_deg": 0.0, **options}
    table = scanned(step(behind), "beam_footprint", **options)
    straddling = np.abs(np.degrees(np.angle(np.exp(1j * table["yaw"])))) < 0.25
    return np.asarray(table["y_noisy"][straddling])


def test_the_rays_of_a_beam_cover_its_ellipse_evenly() -> None:
    """Over a uniform ellipse the variance along an axis is a quarter of the half axis squared."""
    nominal = LEVEL.rays(VLP16, range(20))
    model = open_error_model("beam_footprint")
    fired = model.perturb_rays(nominal, VLP16, Draws(np.random.default_rng(0)))
    yaw = np.degrees(fired.yaw.reshape(-1, 9) - nominal.yaw.reshape(-1, 1))
    pitch = np.degrees(fired.pitch.reshape(-1, 9) - nominal.pitch.reshape(-1, 1))
    assert ((yaw / 0.09) ** 2 + (pitch / 0.045) ** 2).max() < 1
    assert np.array([yaw.std(), pitch.std()]) == pytest.approx([0.045, 0.0225], rel=0.005)
    assert np.unique(yaw.round(9)).size > 0.9 * yaw.size


@pytest.mark.parametrize("returns", ["first", "strongest", "last", "mean"])
def test_a_wall_is_measured_where_it_is(returns: str) -> None:
    """Straight ahead a beam's rays are longer by half their angle squared, at most."""
    table = scanned(wall(5.0), "beam_footprint", **QUIET, returns=returns)
    error = table["distance_noisy"] - table["distance"]
    ahead = table["incidence"] < np.radians(3)
    slope = np.radians(3) * np.radians(0.09)
    assert np.abs(error[ahead]).max() < 5.01 * (slope + np.radians(0.09) ** 2)


def test_at_a_step_the_strongest_echo_is_of_one_side_or_the_other() -> None:
    depths = across_the_edge(5.0)
    assert np.minimum(np.abs(depths - 5), np.abs(depths - 10)).max() < 0.01
    assert 0.3 < (depths < 7).mean() < 0.7


def test_at_a_step_first_and_last_are_of_the_nearer_and_the_farther_side() -> None:
    assert across_the_edge(5.0, returns="first") == pytest.approx(5, abs=0.01)
    assert across_the_edge(5.0, returns="last") == pytest.approx(10, abs=0.01)


@pytest.mark.parametrize(
    ("behind", "options"), [(5.0, {"returns": "mean"}), (0.5, {}), (0.5, {"returns": "first"})]
)
def test_mixed_pixels_lie_between_the_sides_in_proportion_to_the_rays(
    behind: float, options: dict[str, Any]
) -> None:
    share = (across_the_edge(behind, **options) - 5) / behind
    ninths = share * 9
    assert ninths == pytest.approx(np.round(ninths), abs=0.02 + 0.1 / behind)
    assert len(np.unique(np.round(ninths))) > 4
    assert share.mean() == pytest.approx(0.5, abs=0.05)


def test_a_beam_at_the_rim_of_the_only_surface_still_returns() -> None:
    plate = quad([-50, 5, -50], [50, 0, 0], [0, 0, 100])
    table = scanned(plate, "beam_footprint", **QUIET, yaw_width_deg=1.0, returns="mean")
    rim = np.abs(table["x"]) < 0.02
    assert rim.sum() > 50
    assert table["distance_noisy"][rim] == pytest.approx(table["distance"][rim], abs=0.01)


def test_noise_along_the_normal_gives_residuals_of_the_same_sigma_at_any_incidence() -> None:
    sweep = Sweep(duration_s=1.0, azimuth_step_deg=0.5)
    table = scanned(wall(4.0), "surface_normal", sweep)
    residual = table["y_noisy"] - 4
    edges = np.quantile(table["incidence"], [0, 0.25, 0.5, 0.75, 1])
    assert edges[-1] > np.radians(80)
    for low, high in pairwise(edges):
        chosen = (table["incidence"] >= low) & (table["incidence"] <= high)
        tolerance = 4 / np.sqrt(2 * chosen.sum())
        assert residual[chosen].std() == pytest.approx(0.014, rel=tolerance)
    assert np.array_equal(table["x_noisy"], table["x"])
    assert table["distance_noisy"] == pytest.approx(np.linalg.norm(table.xyz_noisy, axis=1))


def test_noise_along_the_ray_shrinks_in_residuals_with_the_cosine() -> None:
    """The same wall under `vlp16`: the contrast that makes the model above worth having."""
    sweep = Sweep(duration_s=1.0, azimuth_step_deg=0.5)
    table = scanned(wall(4.0), "vlp16", sweep, bias_sigma_m=0)
    residual, cosine = table["y_noisy"] - 4, np.cos(table["incidence"])
    assert (residual / cosine).std() == pytest.approx(0.010, rel=4 / np.sqrt(2 * len(table)))


def test_noise_along_the_normal_adds_to_that_along_the_ray() -> None:
    table = scanned(wall(5.0), "surface_normal", bias_sigma_m=0, ray_sigma_m=0.02)
    ahead = table["incidence"] < np.radians(20)
    cosine = np.sqrt((np.cos(table["incidence"][ahead]) ** 2).mean())
    residual = (table["y_noisy"] - 5)[ahead]
    assert residual.std() == pytest.approx(np.hypot(0.014, 0.02 * cosine), rel=0.05)

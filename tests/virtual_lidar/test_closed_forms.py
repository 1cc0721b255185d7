"""Scans of an endless wall and an endless floor against what geometry and statistics say."""

from typing import Any

import numpy as np
import pytest

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import floor, wall
from virtual_lidar import ScanTable, Sweep, open_error_model, scan

VLP16 = load_sensor("vlp16")
# Straight down to straight up, so that both surfaces are met at every incidence.
SWEEP = Sweep(azimuth_step_deg=0.5, pitch_start_deg=-90.0, pitch_end_deg=90.0)
LEVEL = Sweep(azimuth_step_deg=0.5, pitch_start_deg=0.0, pitch_end_deg=0.0)
SURFACES = {"wall": (wall(5.0), "y", 5.0), "floor": (floor(1.5), "z", -1.5)}


def scanned(mesh: Mesh, errors: str = "none", sweep: Sweep = SWEEP, **options: Any) -> ScanTable:
    model = open_error_model(errors, options)
    return scan(mesh, VLP16, sweep, model, [0, 0, 0], np.random.default_rng(11))


def elevation(table: ScanTable, sweep: Sweep) -> Floats:
    """Sine of each ray's elevation over the horizon, by the spherical law of cosines."""
    tilt = sweep.pitch_rad()[table["frame"]]
    yaw, pitch = table["yaw"], table["pitch"]
    return np.sin(pitch) * np.cos(tilt) + np.cos(pitch) * np.cos(yaw) * np.sin(tilt)


@pytest.mark.parametrize("below", [0.5, 1.5, 20.0])
def test_a_floors_distance_and_incidence(below: float) -> None:
    table = scanned(floor(below))
    down = -elevation(table, SWEEP)
    assert table["distance"] == pytest.approx(below / down, abs=1e-9, rel=0)
    assert np.cos(table["incidence"]) == pytest.approx(down, abs=1e-12)
    assert table["z"] == pytest.approx(-below, abs=1e-9, rel=0)
    assert np.array_equal(table.normals, np.tile([0.0, 0.0, 1.0], (len(table), 1)))


def test_every_ray_that_meets_the_floor_within_range_returns() -> None:
    rays = SWEEP.frames * SWEEP.steps(VLP16) * 16
    below, reach = 1.5, VLP16.max_range_m
    tilt = SWEEP.pitch_rad()[:, None, None]
    angles = SWEEP.rays(VLP16, range(SWEEP.frames))
    up = np.sin(angles.pitch) * np.cos(tilt)
    up = up + np.cos(angles.pitch) * np.cos(angles.yaw) * np.sin(tilt)
    assert up.size == rays
    assert len(scanned(floor(below))) == np.count_nonzero(-up >= below / reach)


def spread_by_incidence(table: ScanTable, surface: str, sigma: Floats | float) -> None:
    """Plane residuals over `sigma` have the spread 1 in each 10 degrees of incidence."""
    _, axis, place = SURFACES[surface]
    scaled = (table[f"{axis}_noisy"] - place) / sigma
    tens = (np.degrees(table["incidence"]) // 10).astype(int)
    result = 0
    for ten in range(9):
        some = scaled[tens == ten]
        if len(some) > 500:
            result += 1
            # Five standard errors of a standard deviation, and of a mean.
            assert some.std() == pytest.approx(1, abs=5 / np.sqrt(2 * len(some)))
            assert some.mean() == pytest.approx(0, abs=5 / np.sqrt(len(some)))
    assert result == 9


@pytest.mark.parametrize("surface", SURFACES)
def test_noise_along_the_ray_shrinks_with_the_cosine_of_the_incidence(surface: str) -> None:
    table = scanned(SURFACES[surface][0], "vlp16", bias_sigma_m=0)
    spread_by_incidence(table, surface, 0.010 * np.cos(table["incidence"]))


@pytest.mark.parametrize("surface", SURFACES)
def test_sigma_that_grows_with_incidence_is_seen_through_the_cosine(surface: str) -> None:
    table = scanned(SURFACES[surface][0], "vlp16_incidence", bias_sigma_m=0)
    theta = table["incidence"]
    spread_by_incidence(table, surface, (0.010 + (0.1 * theta) ** 2) * np.cos(theta))


@pytest.mark.parametrize("surface", SURFACES)
def test_noise_along_the_normal_is_the_same_at_every_incidence(surface: str) -> None:
    table = scanned(SURFACES[surface][0], "surface_normal")
    spread_by_incidence(table, surface, 0.014)


def test_figure_5_21_incidence_raises_plane_residuals_by_a_seventh_at_most() -> None:
    """(0.010 + (0.1 theta)^2) cos(theta) has its maximum, 0.01144, at 44 degrees."""
    table = scanned(floor(1.5), "vlp16_incidence", bias_sigma_m=0)
    residual, theta = table["z_noisy"] + 1.5, np.degrees(table["incidence"])
    form = {3: 0.01001, 20: 0.01054, 44: 0.01144, 60: 0.01048, 80: 0.00512}
    for degrees, expected in form.items():
        around = np.abs(theta - degrees) < 2
        assert residual[around].std() == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("surface", SURFACES)
def test_biases_add_to_the_spread_as_their_squares(surface: str) -> None:
    """Frames and lasers share a bias: some 850 draws in ten degrees, known to 2.4 %."""
    table = scanned(SURFACES[surface][0], "vlp16")
    _, axis, place = SURFACES[surface]
    scaled = (table[f"{axis}_noisy"] - place) / np.cos(table["incidence"])
    assert scaled.std() == pytest.approx(np.hypot(0.014, 0.010), rel=0.05)


def test_divergence_on_a_floor_placed_on_the_nominal_ray_errs_by_h_tan_theta() -> None:
    """A pitch off by delta changes the height of a point by h tan(theta) delta, to first order.

    Placed along the fired ray, as BlenSor has it, the point stays on the floor.
    """
    quiet = {"bias_sigma_m": 0, "ray_sigma_m": 0}
    table = scanned(floor(1.0), "vlp16_divergence", LEVEL, returns_along="nominal", **quiet)
    for laser in (0, 6, 12):
        rows = table.select(table["laser_id"] == laser)
        theta = np.radians(90 + VLP16.laser_elevation_deg[laser])
        expected = np.tan(theta) * np.radians(0.09) / np.sqrt(12)
        assert (rows["z_noisy"] + 1).std() == pytest.approx(expected, rel=0.03)
    fired = scanned(floor(1.0), "vlp16_divergence", LEVEL, **quiet)
    assert fired["z_noisy"] == pytest.approx(-1, abs=1e-9)

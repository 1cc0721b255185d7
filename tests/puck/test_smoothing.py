"""Smoothing of a sensor's ranges: planes, edges, biases, and what must stay as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pointkit.geometry.cholesky import solve
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import Layout, Turn
from puck.smoothing import _eliminate, smoothed_distances, smoothed_ranges
from tests.support.returns import dual, homemade

COLUMN = np.radians(0.2)


def directions(lasers: int, columns: int) -> Floats:
    """Lasers 2 degrees apart about the horizon, columns from straight ahead to the right."""
    up = np.radians(2.0 * (np.arange(lasers) - (lasers - 1) / 2))[:, None]
    side = COLUMN * (np.arange(columns) - columns / 2)[None]
    return np.stack(
        [np.cos(up) * np.sin(side), np.cos(up) * np.cos(side), np.sin(up) + 0 * side], axis=2
    )


def wall(rays: Floats, normal: tuple[float, float, float], distance: float) -> Floats:
    """Ranges to a plane."""
    return np.asarray(distance / (rays @ (np.array(normal) / np.linalg.norm(normal))))


def smoothed(ranges: Floats, rays: Floats, step: float) -> Floats:
    return smoothed_ranges(ranges, rays, np.zeros(rays.shape), COLUMN, False, step)


def rms(errors: Floats) -> float:
    return float(np.sqrt(np.mean(errors**2)))


@pytest.mark.parametrize("columns", [40, 160])
def test_the_error_on_a_plane_falls_with_the_root_of_the_returns(columns: int) -> None:
    """Three numbers of a plane fitted to n returns leave sigma sqrt(3 / n)."""
    rays, sigma = directions(1, columns), 0.01
    truth = wall(rays, (0.3, 1.0, 0.0), 6.0)
    errors = []
    for seed in range(40):
        noisy = truth + np.random.default_rng(seed).normal(0, sigma, truth.shape)
        errors.append(rms(smoothed(noisy, rays, 0.002) - truth))
    assert 0.6 < rms(np.array(errors)) / (sigma * np.sqrt(3 / columns)) < 1.3


def test_quantisation_goes_where_a_plane_crosses_many_steps() -> None:
    rays = directions(16, 300)
    truth = wall(rays, (1.0, 1.0, 0.2), 5.0)
    coded = np.rint(truth / 0.1) * 0.1
    assert rms(coded - truth) > 0.025
    assert rms(smoothed(coded, rays, 0.1) - truth) < 0.003


def test_an_edge_stays_where_it_is() -> None:
    rays = directions(8, 200)
    near, far = wall(rays, (0.0, 1.0, 0.0), 4.0), wall(rays, (0.0, 1.0, 0.0), 4.3)
    truth = np.where(np.arange(200) < 87, near, far)
    noisy = truth + np.random.default_rng(1).normal(0, 0.01, truth.shape)
    assert np.abs(smoothed(noisy, rays, 0.002) - truth).max() < 0.008


def test_a_corner_of_two_walls_stays_sharp() -> None:
    rays = directions(8, 300)
    walls = wall(rays, (-0.6, 1.0, 0.0), 4.0), wall(rays, (0.6, 1.0, 0.0), 4.0)
    truth = np.minimum(*walls)
    noisy = truth + np.random.default_rng(2).normal(0, 0.01, truth.shape)
    assert rms(smoothed(noisy, rays, 0.002) - truth) < 0.002


def test_biases_of_lasers_are_found() -> None:
    """From a floor and two walls."""
    rays = directions(16, 600)
    planes = [((0.0, 0.0, -1.0), 0.6), ((0.5, 1.0, 0.0), 4.0), ((-1.0, 0.7, 0.0), 3.0)]
    each = np.array([wall(rays, *plane) for plane in planes])
    truth = np.where(each > 0, each, np.inf).min(axis=0)
    biases = 0.015 * np.cos(2.4 * np.arange(16))
    biases -= biases.mean()
    noisy = truth + biases[:, None] + np.random.default_rng(3).normal(0, 0.01, truth.shape)
    assert rms(noisy - truth) > 0.014
    assert rms(smoothed(noisy, rays, 0.002) - truth) < 0.004


def test_what_lies_on_no_plane_hardly_moves() -> None:
    """Leaves before a wall, and leaves alone, which are not taken for noise of a metre."""
    rays = directions(16, 300)
    leaves = np.random.default_rng(4).uniform(8, 10, rays.shape[:2])
    leaves[:, ::5] = 0
    coded = np.where(np.arange(300) < 150, np.rint(leaves / 0.01) * 0.01, 0)
    coded += np.where(np.arange(300) < 150, 0, np.rint(wall(rays, (0.3, 1, 0), 9) / 0.01) * 0.01)
    moved = smoothed(coded, rays, 0.01) - coded
    assert (moved[:, :150:5] == 0).all()
    assert rms(moved[:, :150]) < 0.003
    assert np.abs(moved).max() < 0.02
    assert np.abs(smoothed(leaves, rays, 0.01) - leaves).max() < 0.2


def test_returns_stay_near_to_their_interval() -> None:
    """A post as wide as three columns, 60 mm before a wall, at steps of 10 mm."""
    rays = directions(16, 200)
    truth = wall(rays, (0.0, 1.0, 0.0), 5.0)
    truth[:, 100:103] -= 0.06
    coded = np.rint(truth / 0.01) * 0.01
    distances = smoothed(coded, rays, 0.01)
    assert np.abs(distances - truth).max() < 0.02
    assert (distances[:, 100:103] < distances[:, 97:98] - 0.04).all()


def test_lone_returns_and_empty_images_stay() -> None:
    rays = directions(4, 50)
    ranges = np.zeros((4, 50))
    assert np.array_equal(smoothed(ranges, rays, 0.01), ranges)
    ranges[2, 20], ranges[1, 40] = 7.3, 2.1
    assert np.array_equal(smoothed(ranges, rays, 0.01), ranges)
    assert smoothed(ranges[:, :1], rays[:, :1], 0.01).shape == (4, 1)


def test_heights_of_lasers_are_taken_into_account() -> None:
    """Rays that start 10 mm apart see one floor."""
    rays, heights = directions(8, 200), np.array([0.01, -0.01] * 4)
    down = rays[..., 2] < -0.02
    with np.errstate(divide="ignore"):
        truth = np.where(down, (-1.5 - heights[:, None]) / rays[..., 2], 0)
    coded = np.rint(truth / 0.02) * 0.02
    origins = np.zeros(rays.shape)
    origins[..., 2] = heights[:, None]
    distances = smoothed_ranges(coded, rays, origins, COLUMN, False, 0.02)
    flat = (
        distances[down] * rays[..., 2][down] + np.broadcast_to(heights[:, None], down.shape)[down]
    )
    assert np.abs(flat + 1.5).max() < 0.001


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("offsets", ["sideways_mm", "radial_mm"])
def test_beams_beside_the_axis_are_taken_into_account(clockwise: bool, offsets: str) -> None:
    """Beams pass the axis 26 mm to either side, as those of an HDL-64E, or start 26 mm before or
    behind it; walls are all around."""
    lasers, columns, quantum = 16, 900, 0.002
    turn = Turn(
        np.ones((1, columns, lasers), np.uint16), (40 * np.arange(columns)).astype(np.uint16)
    )
    beams = Beams(
        tuple(np.linspace(-15, 15, lasers).tolist()), (0.0,) * lasers, (0.0,) * lasers,
        clockwise=clockwise, **{offsets: (26.0, -26.0) * (lasers // 2)},
    )  # fmt: skip
    returns = Returns(beams, Layout(tuple(range(lasers))), (turn,), quantum, "Beside")
    starts = returns.points([np.zeros((1, columns, lasers))])
    rays = returns.points([np.ones((1, columns, lasers))]) - starts
    truth = np.full(len(rays), np.inf)
    for normal in ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)):
        turned = np.array(normal) @ [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]
        with np.errstate(divide="ignore"):
            length = (4.0 - starts @ turned) / (rays @ turned)
        truth = np.where(length > 0, np.minimum(truth, length), truth)
    truth = truth.reshape(columns, lasers)
    step = 0.1
    coded = np.rint(np.rint(truth / step) * step / quantum).astype(np.uint16)
    seen = replace(returns, turns=(replace(turn, ranges=coded[None]),))
    distances = smoothed_distances(seen, seen.turns[0], step)[0]
    assert rms(coded * quantum - truth) > 0.025
    assert rms(distances - truth) < 0.003


def test_second_returns_stay() -> None:
    returns = dual()
    turn = returns.turns[0]
    distances = smoothed_distances(returns, turn, 0.05)
    assert np.array_equal(distances[1], turn.ranges[1] * returns.quantum_m)
    assert not np.array_equal(distances[0], turn.ranges[0] * returns.quantum_m)


@pytest.mark.parametrize(
    "beams",
    [
        {"heights_mm": (1e300, -1e300, 0.0, 0.0, 0.0)},
        {"heights_mm": (1e14,) * 5},
        {"elevations_deg": (90.0, -90.0, 450.0, 1e300, 0.0)},
        {"elevations_deg": (0.0,) * 5},
    ],
)
def test_beams_of_no_sensor_give_finite_points(beams: dict[str, tuple[float, ...]]) -> None:
    returns = homemade()
    strange = replace(returns, beams=replace(returns.beams, **beams))
    for turn in strange.turns:
        for step in (1e-9, 0.004, 1e12):
            distances = smoothed_distances(strange, turn, step)
            assert np.isfinite(distances).all()
            assert ((distances > 0) == (turn.ranges > 0)).all()


def test_azimuths_of_no_turn_are_survived() -> None:
    random = np.random.default_rng(5)
    beams, layout = Beams((-1.0, 1.0), (0.0, 0.0), (0.0, 0.5)), Layout((1, 0))
    for blocks in (1, 2, 3, 500):
        turn = Turn(
            random.integers(0, 1 << 16, (1, blocks, 2), dtype=np.uint16),
            random.integers(0, 1 << 16, blocks, dtype=np.uint16),
        )
        returns = Returns(beams, layout, (turn,), 0.002)
        assert np.isfinite(smoothed_distances(returns, turn, 0.01)).all()


def test_biases_minimise_the_squares_of_planes_and_biases_together() -> None:
    """As a dense solver finds them, of planes and biases at once."""
    lasers, planes, random = 5, 3, np.random.default_rng(6)
    rows = random.normal(size=(planes, lasers, 40, 3))
    targets = rows @ random.normal(size=3) + random.normal(0, 0.1, rows.shape[:3])
    products = np.zeros((planes, 3, 4))
    products[:, :, :3] = np.einsum("plni,plnj->pij", rows, rows)
    products[:, :, 3] = np.einsum("plni,pln->pi", rows, targets)
    mixed = rows.sum(axis=2)
    matrix, right = np.diag(np.full(lasers, 40.0 * planes)), targets.sum(axis=(0, 2))
    design = np.zeros((*targets.shape, 3 * planes + lasers))
    for plane in range(planes):
        design[plane, ..., 3 * plane : 3 * plane + 3] = rows[plane]
    for laser in range(lasers):
        design[:, laser, :, 3 * planes + laser] = 1
    design = design.reshape(-1, design.shape[-1])
    expected = np.linalg.lstsq(design, targets.ravel(), rcond=None)[0][3 * planes :]
    _eliminate(products, mixed, matrix, right)
    solve(matrix, right)
    np.testing.assert_allclose(right, expected, rtol=1e-6, atol=1e-8)

"""Points on the rays of a spinning sensor: what streams depend on, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from puck.clouds.layout import CloudField, CloudLayout
from puck.clouds.ray_loops import fitted_line
from puck.clouds.rays import Rays, fitted_rays

RINGS, STEPS = 4, 1800


@pytest.fixture(scope="module")
def rays() -> Rays:
    random = np.random.default_rng(1)
    lines = random.normal(0, 0.01, (RINGS, 6))
    lines[:, 3] += 0.002
    return Rays(lines, STEPS, 2 * np.pi / STEPS, 0.3, True, True)


def test_coordinates_are_those_of_numpy_to_the_last_bit(rays: Rays) -> None:
    """Streams hold the errors of these coordinates, and must decode in every version."""
    random = np.random.default_rng(2)
    rings, azimuths = random.integers(0, RINGS, 5000), random.integers(0, STEPS, 5000)
    ranges = random.integers(0, 50_000, 5000).astype(float)
    x, y, z = rays.predicted(rings, azimuths, ranges)
    first = rays.predicted(np.zeros(STEPS, int), np.arange(STEPS), np.zeros(STEPS))
    along, side, height = rays.lines[0, :3]
    angles = np.arange(STEPS) * rays.step + rays.phase
    cosines, sines = np.cos(angles), np.sin(angles)
    np.testing.assert_allclose(first[0], along * cosines - side * sines, atol=1e-15)
    np.testing.assert_allclose(first[1], along * sines + side * cosines, atol=1e-15)
    assert (first[2] == height).all()
    unit = Rays(np.eye(RINGS, 6), STEPS, rays.step, rays.phase, True, True)
    cosine, sine, _ = unit.predicted(np.zeros(5000, int), azimuths, ranges)
    lines = rays.lines[rings].T
    along, side = lines[0] + lines[3] * ranges, lines[1] + lines[4] * ranges
    assert (x == along * cosine - side * sine).all()
    assert (y == along * sine + side * cosine).all()
    assert (z == lines[2] + lines[5] * ranges).all()
    for is_x, values in ((True, x), (False, y)):
        which = np.full(5000, is_x)
        single = values.astype(np.float32)
        start = lines[0] * cosine - lines[1] * sine, lines[0] * sine + lines[1] * cosine
        more = lines[3] * cosine - lines[4] * sine, lines[3] * sine + lines[4] * cosine
        expected = (single - start[not is_x]) / more[not is_x]
        assert (rays.refined(rings, azimuths, single, which) == expected).all()


def test_points_are_found_where_they_were_put() -> None:
    random = np.random.default_rng(3)
    rings, azimuths = random.integers(0, RINGS, 4000), random.integers(0, STEPS, 4000)
    ranges = random.integers(2000, 50_000, 4000)
    elevations, zeros = np.linspace(-0.2, 0.2, RINGS), np.zeros(RINGS)
    along, up = 0.002 * np.cos(elevations), 0.002 * np.sin(elevations)
    lines = np.stack([zeros, zeros, zeros + 0.05, along, zeros, up], axis=1)
    straight = Rays(lines, STEPS, 2 * np.pi / STEPS, 0.0, True, True)
    xyz = np.stack(straight.predicted(rings, azimuths, ranges.astype(float)), axis=1)
    for found in (straight.located(xyz, rings), fitted_rays(xyz, rings)):
        assert found is not None
        assert found.rays.is_stepped
        assert (found.azimuths == azimuths).all()
        assert (found.ranges == ranges).all()


def test_a_line_is_fitted_without_outliers() -> None:
    x = np.arange(100.0)
    y = 3 - 0.5 * x
    y[::10] += 40
    assert fitted_line(x, y) == pytest.approx((3, -0.5), abs=1e-9)
    assert fitted_line(x[:2], np.array([1.0, 2.0])) == (1.5, 0)


def test_constant_columns_are_read_and_written_with_the_others() -> None:
    fields = CloudField("x", 0, 7, 1), CloudField("ring", 6, 4, 1)
    layout = CloudLayout(fields, 10, False)
    points = np.random.default_rng(4).integers(0, 256, (50, 10)).astype(np.uint8)
    points[:, 4:8] = 7, 0, 9, 200
    values = layout.all_values(points)
    for column, numbers in zip(layout.columns, values, strict=True):
        assert (numbers == layout.values(points, column)).all()
        assert (numbers.strides == (0,)) == (column.offset in {4, 5, 6})
    assert (layout.points_with(values) == points).all()

"""Loops over rays, against numpy and closed forms."""

from typing import Any

import numpy as np
import pytest

from puckbench.geometry.cloud import Floats
from puckbench.lidar import kernels

RANDOM = np.random.default_rng(4)
STEPS, PER_STEP, RAYS = 4, 3, 12


def unit_vectors(count: int) -> Floats:
    vectors = np.random.default_rng(count).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


DIRECTIONS, NORMALS = unit_vectors(RAYS), unit_vectors(5)
STARTS, AWAY = RANDOM.normal(size=(STEPS, 3)), RANDOM.random(5) * 9
TRIANGLES = RANDOM.integers(0, 5, RAYS).astype(np.uint32)
ROWS = RANDOM.random(RAYS) < 0.7
PLANES = np.column_stack([NORMALS, AWAY])


def columns(count: int, dtype: Any = np.float64) -> tuple[Any, ...]:
    return tuple(np.full(20, -1, dtype) for _ in range(count))


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_planes_of_triangles_of_any_size(size: float) -> None:
    corners = RANDOM.normal(size=(6, 3, 3)) * size
    corners[5, 2] = corners[5, 1]  # no area
    origin, planes = np.array([0.5, -1.0, 2.0]), np.empty((6, 4))
    kernels.fill_planes(corners.reshape(-1, 3), np.arange(18).reshape(6, 3), origin, planes)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:5]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(planes[:5, :3], across, atol=1e-9)
    away = (across * (corners[:5, 0] - origin)).sum(axis=1)
    np.testing.assert_allclose(planes[:5, 3], away, atol=1e-9 * max(size, 1))
    assert not planes[5].any()


def test_directions_are_those_of_yaw_and_pitch_turned_with_the_sensor() -> None:
    """Yaw from forward (y) to the left (-x), pitch upwards."""
    yaw, pitch = RANDOM.random((2, 2, 2, 3)) * 6
    rotations = np.linalg.qr(RANDOM.normal(size=(2, 2, 3, 3)))[0]
    directions, rays = np.empty((12, 3)), np.zeros((12, 6), np.float32)
    pairs = [(np.sin(angle), np.cos(angle)) for angle in (yaw, pitch)]
    kernels.fill_directions(*pairs, rotations, directions, rays)
    own = np.stack([-np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)], -1)
    expected = np.einsum("fsij,fskj->fski", rotations, own).reshape(-1, 3)
    np.testing.assert_allclose(directions, expected, atol=1e-12)
    np.testing.assert_array_equal(rays[:, 3:], directions.astype(np.float32))
    assert not rays[:, :3].any()


def test_distances_are_those_along_rays_to_planes() -> None:
    nearest = np.where(np.arange(RAYS) % 4, 1.0, np.inf).astype(np.float32)
    distances, cosines = np.empty(RAYS), np.empty(RAYS)
    limits = (-3.0, 20.0)
    kernels.fill_distances(
        DIRECTIONS, nearest, TRIANGLES, PLANES, STARTS, limits, distances, cosines
    )
    normals, starts = NORMALS[TRIANGLES], np.repeat(STARTS, PER_STEP, axis=0)
    cosine = (normals * DIRECTIONS).sum(axis=1)
    expected = (AWAY[TRIANGLES] - (normals * starts).sum(axis=1)) / cosine
    hit = np.isfinite(nearest) & (expected >= -3) & (expected <= 20)
    assert 0 < hit.sum() < np.isfinite(nearest).sum()
    np.testing.assert_allclose(distances, np.where(hit, expected, np.inf))
    np.testing.assert_allclose(cosines, np.where(hit, np.abs(cosine), np.nan))


@pytest.mark.parametrize(
    ("limits", "found"), [((2.0, 2.0), 2.0), ((2.1, 9.0), np.inf), ((0.0, 1.9), np.inf)]
)
def test_limits_of_the_range_are_within_it(limits: tuple[float, float], found: float) -> None:
    assert distance_to(2.0, 1.0, limits)[0] == found


@pytest.mark.parametrize(("cosine", "found"), [(1.0, 2.0), (-2e-9, 2.0), (5e-10, 2.5)])
def test_where_a_ray_grazes_a_plane_the_distance_is_embrees(cosine: float, found: float) -> None:
    """A plane's distance is known to 2^-52, so that it is over a cosine of 1e-9 to 2e-7: as well
    as in Embree's single precision.
    """
    assert distance_to(2.0, cosine) == pytest.approx((found, abs(cosine)), rel=1e-12)


def distance_to(
    distance: float, cosine: float, limits: tuple[float, float] = (0.0, 10.0)
) -> tuple[float, float]:
    """Distance and cosine of a ray to a plane at a distance, of which Embree says 2.5."""
    directions = np.array([[np.sqrt(1 - cosine**2), 0, cosine]])
    planes = np.array([[0.0, 0, 1, distance * cosine]])
    result, cosines = np.empty(1), np.empty(1)
    nearest, triangles = np.array([2.5], np.float32), np.zeros(1, np.uint32)
    starts = np.zeros((1, 3))
    kernels.fill_distances(directions, nearest, triangles, planes, starts, limits, result, cosines)
    return result[0], cosines[0]


def test_rays_that_returned_follow_each_other() -> None:
    rows = ROWS.reshape(2, 2, 3)
    nominal = tuple(RANDOM.random((3, 2, 2, 3)))
    out = columns(5)
    end = kernels.fill_rays(rows, nominal, 7, 2, out)
    assert end == 2 + ROWS.sum()
    frame, _, laser = np.nonzero(rows)
    expected = [7 + frame, laser, *(values[rows] for values in nominal)]
    np.testing.assert_array_equal([column[2:end] for column in out], expected)
    assert all((np.delete(column, np.s_[2:end]) == -1).all() for column in out)


def test_points_lie_along_their_rays() -> None:
    distances, out = RANDOM.random(RAYS) * 9, columns(4)
    kernels.fill_points(ROWS, STARTS, DIRECTIONS, distances, 1, out)
    points = np.repeat(STARTS, PER_STEP, axis=0) + distances[:, None] * DIRECTIONS
    result = np.stack(out, axis=1)[1 : 1 + ROWS.sum()]
    np.testing.assert_allclose(result, np.column_stack([distances, points])[ROWS])
    assert (out[0][1 + ROWS.sum() :] == -1).all()


def test_normals_look_at_the_sensor() -> None:
    incidence, out = RANDOM.random(RAYS), columns(7)
    objects, primitives = np.arange(10, 15, dtype=np.int32), np.arange(20, 25, dtype=np.int32)
    surface = (PLANES, objects, primitives)
    kernels.fill_surface(ROWS, (DIRECTIONS, TRIANGLES, incidence), surface, 3, out)
    normals = NORMALS[TRIANGLES]
    normals = normals * -np.sign((normals * DIRECTIONS).sum(axis=1, keepdims=True))
    numbers = [TRIANGLES, objects[TRIANGLES], primitives[TRIANGLES]]
    expected = np.column_stack([incidence, *numbers, normals])[ROWS]
    np.testing.assert_allclose(np.stack(out, axis=1)[3 : 3 + ROWS.sum()], expected)


FIRST, STRONGEST, LAST, TOGETHER = range(4)


@pytest.mark.parametrize(
    ("choice", "distance", "middle"),
    [(FIRST, 2.0, 1), (STRONGEST, 5.2, 5), (LAST, 9.08, 7), (TOGETHER, 44.84 / 7, 0)],
)
def test_an_echo_is_of_rays_that_are_near_in_range(
    choice: int, distance: float, middle: int
) -> None:
    """Echoes of one ray, of three at 5.0 to 5.4 m, and of three at 9.0 to 9.2 m; and a miss."""
    apart = np.array([[5.4, 2.0, 5.0, 9.2, 9.0, 5.2, np.inf, 9.04]])
    result, nearest = np.empty(1), np.empty(1, np.int64)
    kernels.fill_echoes(apart, 0.2 + 1e-9, choice, result, nearest)
    assert result[0] == pytest.approx(distance)
    assert nearest[0] == middle
    kernels.fill_echoes(np.full((1, 3), np.inf), 0.2, choice, result, nearest)
    assert result[0] == np.inf

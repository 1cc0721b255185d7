"""Arithmetic of rays, against closed forms."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import room
from virtual_lidar import open_error_model, open_sweep, scan
from virtual_lidar.errors.beam_footprint import Echo, echoes
from virtual_lidar.kernels import fill_distances
from virtual_lidar.raycast import RayCaster
from virtual_lidar.sweep import Rays
from virtual_lidar.trajectory import Poses

RANDOM = np.random.default_rng(4)
RAYS = 12


def unit_vectors(count: int) -> Floats:
    vectors = np.random.default_rng(count).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


DIRECTIONS, NORMALS = unit_vectors(RAYS), unit_vectors(5)
STARTS, AWAY = RANDOM.normal(size=(RAYS, 3)), RANDOM.random(5) * 9
TRIANGLES = RANDOM.integers(0, 5, RAYS)
PLANES = np.column_stack([NORMALS, AWAY])


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_planes_of_triangles_of_any_size(size: float) -> None:
    corners = RANDOM.normal(size=(6, 3, 3)) * size
    corners[5, 2] = corners[5, 1]  # no area
    origin = np.array([0.5, -1.0, 2.0])
    planes = RayCaster(Mesh(corners.reshape(-1, 3), np.arange(18).reshape(6, 3)), origin).planes
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
    poses = Poses(rotations, np.zeros((2, 2, 3)))
    directions = RayCaster(room(), np.ones(3)).cast(Rays(yaw, pitch), poses, (0, 9)).directions
    own = np.stack([-np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)], -1)
    expected = np.einsum("fsij,fskj->fski", rotations, own).reshape(-1, 3)
    np.testing.assert_allclose(directions, expected, atol=1e-12)


def plane_distances(
    directions: Floats,
    starts: Floats,
    nearest: Floats,
    triangles: NDArray[np.int64],
    planes: Floats,
    limits: tuple[float, float] = (-3.0, 20.0),
) -> tuple[Floats, Floats]:
    distances, cosines = np.empty((2, len(directions)))
    found = nearest.astype(np.float32), triangles.astype(np.uint32)
    fill_distances(directions, starts, *found, planes, limits, distances, cosines)
    return distances, cosines


def test_distances_are_those_along_rays_to_planes() -> None:
    nearest = np.where(np.arange(RAYS) % 4, 1.0, np.inf)
    distances, cosines = plane_distances(DIRECTIONS, STARTS, nearest, TRIANGLES, PLANES)
    normals = NORMALS[TRIANGLES]
    cosine = (normals * DIRECTIONS).sum(axis=1)
    expected = (AWAY[TRIANGLES] - (normals * STARTS).sum(axis=1)) / cosine
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
    planes, nearest = np.array([[0.0, 0, 1, distance * cosine]]), np.array([2.5])
    first = np.zeros(1, dtype=np.int64)
    result, cosines = plane_distances(directions, np.zeros((1, 3)), nearest, first, planes, limits)
    return result[0], cosines[0]


def test_points_lie_along_their_rays_and_normals_look_at_the_sensor() -> None:
    mesh, origin = room(skip=("+x",)), np.array([3.1, 2.4, 1.3])
    motion = [[0, 0, 0, 0, 0, 0, 0], [0.2, 0.3, 0.1, 0.05, 20, 3, 2]]
    sweep, model = open_sweep({"preset": "spin", "trajectory": motion}), open_error_model("vlp16")
    table = scan(mesh, load_sensor("vlp16"), sweep, model, origin, np.random.default_rng(1))
    assert 0 < len(table) < sweep.steps(load_sensor("vlp16")) * 16
    poses = sweep.poses_during(table["timestamp"])
    yaw, pitch = table["yaw"], table["pitch"]
    own = np.stack([-np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)], -1)
    rays = np.einsum("nij,nj->ni", poses.rotations, own)
    for points, distance in ((table.xyz, "distance"), (table.xyz_noisy, "distance_noisy")):
        along = table[distance][:, None] * rays
        np.testing.assert_allclose(points, origin + poses.positions + along, atol=1e-9)
    assert ((table.normals * rays).sum(axis=1) < 0).all()
    corners = mesh.vertices[mesh.triangles[table["triangle_id"]]]
    offsets = np.einsum("ncx,nx->nc", corners - table.xyz[:, None], table.normals)
    np.testing.assert_allclose(offsets, 0, atol=1e-9)
    cosine = -(table.normals * rays).sum(axis=1)
    np.testing.assert_allclose(np.cos(table["incidence"]), cosine, atol=1e-9)


@pytest.mark.parametrize(
    ("choice", "distance", "middle"),
    [("first", 2.0, 1), ("strongest", 5.2, 5), ("last", 9.08, 7), ("mean", 44.84 / 7, 0)],
)
def test_an_echo_is_of_rays_that_are_near_in_range(
    choice: Echo, distance: float, middle: int
) -> None:
    """Echoes of one ray, of three at 5.0 to 5.4 m, and of three at 9.0 to 9.2 m; and a miss."""
    apart = np.array([[5.4, 2.0, 5.0, 9.2, 9.0, 5.2, np.inf, 9.04]])
    result, nearest = echoes(apart, 0.2 + 1e-9, choice)
    assert result[0] == pytest.approx(distance)
    assert nearest[0] == middle
    result, _ = echoes(np.full((1, 3), np.inf), 0.2, choice)
    assert result[0] == np.inf

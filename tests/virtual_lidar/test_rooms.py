"""Generated rooms: closed, labelled, furnished, free at the sensor."""

from functools import cache

import numpy as np
import open3d as o3d
import pytest

from pointkit.errors import InputError
from pointkit.geometry.mesh import Mesh, check_mesh
from tests.support.scenes_residuals import assert_furniture_within, plane_alignment, worst_residual
from virtual_lidar.scenes.rooms import ROOMS, RoomSpec, make_room, room_box, room_origin

S3DIS = {
    "ceiling", "floor", "wall", "beam", "column", "window", "door", "table", "chair", "sofa",
    "bookcase", "board", "clutter",
}  # fmt: skip
FACING_AWAY, ESCAPING = 2e-4, 1e-4

every_room = pytest.mark.parametrize("name", ROOMS)


def _size(spec: RoomSpec) -> list[float]:
    return [*np.ptp(np.array(spec.outline), axis=0).tolist(), spec.height]


@cache
def room(name: str) -> Mesh:
    return make_room(name, 3, detail=0.25)


def scene_of(mesh: Mesh) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene()
    vertices = o3d.core.Tensor(mesh.vertices.astype(np.float32))
    scene.add_triangles(vertices, o3d.core.Tensor(mesh.triangles.astype(np.uint32)))
    return scene


@every_room
def test_labels_fit_the_triangles(name: str) -> None:
    mesh = room(name)
    check_mesh(mesh, name)
    assert mesh.labels is not None
    assert len(mesh.labels.object_id) == len(mesh.labels.primitive_id) == len(mesh.triangles)
    assert worst_residual(mesh) < 1e-8
    assert (plane_alignment(mesh) > 0.99).all()
    assert {item.semantic for item in mesh.labels.objects} <= S3DIS


@every_room
def test_the_sensor_is_free_and_sees_front_faces_only(name: str) -> None:
    mesh, place = room(name), np.array(room_origin(name, 3))
    scene = scene_of(mesh)
    point = o3d.core.Tensor(place[None].astype(np.float32))
    assert float(scene.compute_distance(point).numpy()[0]) > 0.3
    directions = np.random.default_rng(0).normal(size=(20_000, 3))
    rays = np.hstack([np.broadcast_to(place, directions.shape), directions]).astype(np.float32)
    hits = scene.cast_rays(o3d.core.Tensor(rays))
    result = np.isfinite(hits["t_hit"].numpy())
    away = (
        np.sum(mesh.normals()[hits["primitive_ids"].numpy()[result]] * directions[result], axis=1)
        > 0
    )
    assert np.mean(~result) <= ESCAPING
    assert np.mean(away) <= FACING_AWAY


@every_room
def test_rooms_have_the_sizes_of_the_catalogue(name: str) -> None:
    mesh, box = room(name), room_box(name)
    assert mesh.labels is not None
    floor = mesh.corners()[mesh.labels.object_id == 0].reshape(-1, 3)
    assert mesh.labels.objects[0].semantic == "floor"
    assert np.stack([floor.min(axis=0), floor.max(axis=0)])[:, :2] == pytest.approx(box[:, :2])
    assert np.ptp(box, axis=0) == pytest.approx(_size(ROOMS[name]))
    low, high = mesh.bounds()
    assert low[2] > -0.02
    assert high[2] == pytest.approx(box[1, 2])


@every_room
def test_furniture_stays_in_the_room(name: str) -> None:
    mesh, (low, high) = room(name), room_box(name)
    assert_furniture_within(mesh, low, high)


def test_rooms_differ_in_type_size_and_elongation() -> None:
    sides = np.array([_size(spec) for spec in ROOMS.values()])
    elongation = sides.min(axis=1) / sides.max(axis=1)
    assert len(ROOMS) >= 10
    assert {spec.kind for spec in ROOMS.values()} >= {"office", "hallway", "storage", "auditorium"}
    assert elongation.min() < 0.15
    assert elongation.max() > 0.8
    assert np.ptp(sides[:, 0] * sides[:, 1]) > 80


def test_the_seed_determines_the_room() -> None:
    first, again, other = (make_room("office_1", seed, 0.25) for seed in (5, 5, 6))
    assert np.array_equal(first.vertices, again.vertices)
    assert np.array_equal(first.triangles, again.triangles)
    assert first.labels is not None
    assert again.labels is not None
    assert first.labels.primitives == again.labels.primitives
    assert first.vertices.shape != other.vertices.shape or (first.vertices != other.vertices).any()
    assert room_origin("office_1", 5) == room_origin("office_1", 5) != room_origin("office_1", 6)


@pytest.mark.parametrize("name", ["copy_room_1", "auditorium_1"])
def test_numbers_of_triangles_of_the_smallest_and_largest_room(name: str) -> None:
    assert 20_000 <= len(make_room(name, 0).triangles) <= 500_000


def test_unknown_room_is_refused() -> None:
    with pytest.raises(InputError, match="ballroom"):
        make_room("ballroom", 0)

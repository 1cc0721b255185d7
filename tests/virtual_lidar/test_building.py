"""The generated building: S3DIS's counts, different rooms, furniture inside."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import open3d as o3d
import pytest

from pointkit.geometry.mesh import Mesh, check_mesh
from tests.support.scenes_residuals import assert_furniture_within, worst_residual
from virtual_lidar.scenes.rooms import (
    MAX_STRETCH,
    ROOM_CHOICES,
    ROOMS,
    make_room,
    room_box,
    room_origin,
    room_spec,
    room_types,
    stretched,
)

SOME = (
    "Area_2_WC_1", "Area_2_auditorium_2", "Area_1_conferenceRoom_1", "Area_6_copyRoom_1",
    "Area_5_hallway_13", "Area_4_lobby_2", "Area_3_lounge_1", "Area_1_office_1",
    "Area_6_openspace_1", "Area_5_pantry_1", "Area_2_storage_9",
)  # fmt: skip


@cache
def room(name: str) -> Mesh:
    return make_room(name, 3, detail=0.25)


def test_areas_have_the_published_numbers_of_rooms() -> None:
    names = list(room_types())
    counts = Counter(name.split("_")[1] for name in names)
    assert len(names) == len(set(names)) == 272
    assert dict(counts) == {"1": 44, "2": 40, "3": 23, "4": 49, "5": 68, "6": 48}
    assert set(room_types().values()) == set(ROOM_CHOICES)
    assert {name for bases in ROOM_CHOICES.values() for name in bases} == set(ROOMS)


def test_rooms_have_different_shapes_that_depend_on_the_seed() -> None:
    shapes = {room_spec(name, 0).outline for name in room_types() if "auditorium" not in name}
    assert len(shapes) == 270
    assert room_spec("Area_1_office_1", 0) == room_spec("Area_1_office_1", 0)
    assert room_spec("Area_1_office_1", 0).outline != room_spec("Area_1_office_1", 1).outline
    assert not np.array_equal(
        make_room("Area_2_auditorium_1", 0, 0.2).vertices[:5000],
        make_room("Area_2_auditorium_2", 0, 0.2).vertices[:5000],
    )


@pytest.mark.parametrize("name", SOME)
def test_a_room_is_labelled_and_its_sensor_is_free(name: str) -> None:
    mesh, place, (low, high) = room(name), np.array(room_origin(name, 3)), room_box(name, 3)
    check_mesh(mesh, name)
    assert worst_residual(mesh) < 1e-8
    scene = o3d.t.geometry.RaycastingScene()
    triangles = o3d.core.Tensor(mesh.triangles.astype(np.uint32))
    scene.add_triangles(o3d.core.Tensor(mesh.vertices.astype(np.float32)), triangles)
    point = o3d.core.Tensor(place[None].astype(np.float32))
    assert float(scene.compute_distance(point).numpy()[0]) > 0.3
    assert ((place > low) & (place < high)).all()


@pytest.mark.parametrize("name", sorted(set(ROOMS) - {"auditorium_1"}))
def test_furniture_stays_in_a_room_of_maximal_stretch(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ROOMS, name, stretched(ROOMS[name], MAX_STRETCH, MAX_STRETCH))
    mesh, (low, high) = make_room(name, 1, 0.2), room_box(name)
    assert_furniture_within(mesh, low, high)

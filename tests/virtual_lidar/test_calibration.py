"""Calibration scenes against the set-up of the measurements."""

import numpy as np
import pytest

from pointkit.errors import InputError
from virtual_lidar.scenes.calibration import CALIBRATIONS, calibration_origin, make_calibration


@pytest.mark.parametrize(("name", "distance"), CALIBRATIONS.items())
def test_wall_and_floor_have_their_sizes_and_face_the_sensor(name: str, distance: float) -> None:
    mesh = make_calibration(name)
    assert mesh.labels is not None
    wall, floor = (mesh.corners()[mesh.labels.object_id == k] for k in (0, 1))
    assert [item.semantic for item in mesh.labels.objects] == ["wall", "floor"]
    expected_wall = [(-0.8, 0, 0), (0.8, 0, 2.2)]
    assert [wall.min((0, 1)), wall.max((0, 1))] == [
        pytest.approx(p, abs=1e-12) for p in expected_wall
    ]
    expected_floor = [(-0.8, 0, 0), (0.8, distance, 0)]
    assert [floor.min((0, 1)), floor.max((0, 1))] == [
        pytest.approx(p, abs=1e-12) for p in expected_floor
    ]
    to_sensor = np.array(calibration_origin(name)) - mesh.corners().mean(axis=1)
    assert (np.sum(mesh.normals() * to_sensor, axis=1) > 0).all()


def test_the_room_closes_around_wall_and_floor() -> None:
    mesh = make_calibration("wall_floor_3m", room=True)
    alone = make_calibration("wall_floor_3m")
    assert mesh.labels is not None
    np.testing.assert_array_equal(mesh.corners()[: len(alone.triangles)], alone.corners())
    corners = mesh.corners()
    assert (corners.min((0, 1)), corners.max((0, 1))) == (
        pytest.approx([-2.5, 0, 0], abs=1e-12),
        pytest.approx([2.5, 3, 2.6], abs=1e-12),
    )
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    # Front wall, floor, ceiling and two sides, without a gap or a double.
    assert areas.sum() / 2 == pytest.approx(5 * 2.6 + 2 * 5 * 3 + 2 * 3 * 2.6)
    to_sensor = np.array(calibration_origin("wall_floor_3m")) - corners.mean(axis=1)
    assert (np.sum(mesh.normals() * to_sensor, axis=1) > 0).all()
    assert {item.semantic for item in mesh.labels.objects[2:]} == {"surroundings"}


def test_distances_are_those_of_the_measurements() -> None:
    assert sorted(CALIBRATIONS.values()) == [1, 2, 3, 4, 5, 30]
    assert calibration_origin("wall_floor_5m") == (0.0, 5.0, 1.0)


def test_planes_are_the_wall_and_the_floor() -> None:
    labels = make_calibration("wall_floor_2m").labels
    assert labels is not None
    assert [item.parameters["offset"] for item in labels.primitives] == pytest.approx([0, 0])
    normals = [item.parameters["normal"] for item in labels.primitives]
    assert normals == [pytest.approx([0, 1, 0]), pytest.approx([0, 0, 1])]


def test_unknown_scene_is_refused() -> None:
    with pytest.raises(InputError, match="wall_floor_9m"):
        make_calibration("wall_floor_9m")

"""Generated scenes as scene sets."""

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.scene_sets.calibration import CalibrationScenes
from puckbench.scene_sets.embedded_objects import EmbeddedObjects
from puckbench.scene_sets.embedded_rooms import EmbeddedRooms
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.street import Street

SMALL = "copy_room_1"


def test_rooms_are_chosen_by_name_or_by_number() -> None:
    every = EmbeddedRooms().names()
    assert len(every) >= 10
    assert every == sorted(every)
    assert len(EmbeddedRooms(rooms=3).names()) == 3
    assert EmbeddedRooms(rooms=(SMALL,)).names() == [SMALL]


@pytest.mark.parametrize(
    ("rooms", "message"),
    [
        (("office_99",), "rooms: unknown name 'office_99'"),
        (0, "rooms: 0 is not from 1 to"),
        (1000, "rooms: 1000 is not from 1 to"),
        ((), "rooms: no names"),
    ],
)
def test_rooms_that_do_not_exist_are_named(rooms: tuple[str, ...] | int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        EmbeddedRooms(rooms=rooms).names()


def test_a_room_has_labels_a_sensor_within_its_box_and_a_type() -> None:
    scene = EmbeddedRooms(seed=4).load(SMALL)
    assert scene.mesh is not None
    assert scene.mesh.labels is not None
    assert scene.box is not None
    assert (np.array(scene.origin) > scene.box[0]).all()
    assert (np.array(scene.origin) < scene.box[1]).all()
    assert scene.group == "copy_room"
    assert scene.about["seed"] == 4


def test_the_seed_makes_the_room() -> None:
    first, again, other = (EmbeddedRooms(seed=seed).load(SMALL).mesh for seed in (1, 1, 2))
    assert first is not None
    assert again is not None
    assert other is not None
    assert np.array_equal(first.vertices, again.vertices)
    assert first.vertices.shape != other.vertices.shape or (first.vertices != other.vertices).any()


def test_objects_are_chosen_by_class_and_member() -> None:
    assert len(EmbeddedObjects().names()) == 15 * 12
    objects = EmbeddedObjects(classes=("chair", "cup"), members=2)
    assert objects.names() == ["chair_01", "chair_02", "cup_01", "cup_02"]
    with pytest.raises(InputError, match="classes: unknown name 'char'"):
        EmbeddedObjects(classes=("char",)).names()
    with pytest.raises(InputError, match="members: 13 is not from 1 to 12"):
        EmbeddedObjects(members=13).names()


def test_an_object_has_its_class_as_group() -> None:
    scene = EmbeddedObjects(seed=2).load("pipe_fitting_03")
    assert scene.mesh is not None
    assert scene.group == "pipe_fitting"
    assert np.ptp(scene.mesh.bounds(), axis=0).max() == pytest.approx(1)


def test_a_calibration_scene_has_the_sensor_at_its_distance() -> None:
    scene = CalibrationScenes(scenes=("wall_floor_5m",)).load("wall_floor_5m")
    assert scene.mesh is not None
    assert scene.origin is not None
    assert scene.origin[1] == 5
    assert scene.mesh.areas().sum() == pytest.approx(1.6 * 2.2 + 1.6 * 5)


def test_a_street_has_its_sensor_in_the_middle_of_its_free_way() -> None:
    streets = Street(seed=3, streets=2, length_m=60)
    assert streets.names() == ["street_1", "street_2"]
    scene = streets.load("street_2")
    assert scene.mesh is not None
    assert scene.mesh.labels is not None
    assert scene.group == "street"
    assert scene.origin is not None
    assert scene.about["free_way_m"] == [-30.0, 30.0]
    assert scene.about["length_m"] == 60
    assert scene.about["seed"] == 3
    assert streets.files("street_2") == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"length_m": 10}, "length_m is 10, but must be greater than or equal to 40"),
        ({"streets": 0}, "streets is 0, but must be greater than 0"),
    ],
)
def test_streets_that_cannot_be_are_refused(options: dict[str, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        open_scene_set("street", options, 0)


def test_a_street_that_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match="no scene 'street_9'"):
        Street().load("street_9")

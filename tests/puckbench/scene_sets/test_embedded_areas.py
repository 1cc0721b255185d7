"""The data set of the generated building's rooms."""

from __future__ import annotations

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.scene_sets.embedded_areas import EmbeddedAreas
from virtual_lidar.scenes.rooms import (
    room_box,
)


def test_rooms_are_chosen_by_area_and_number() -> None:
    assert EmbeddedAreas(areas=("Area_3",), rooms=2).names() == ["Area_3_WC_1", "Area_3_WC_2"]
    assert len(EmbeddedAreas(areas=2).names()) == 84
    with pytest.raises(InputError, match="areas: unknown name 'Area_7'"):
        EmbeddedAreas(areas=("Area_7",)).names()


def test_a_scene_has_a_type_and_a_box() -> None:
    scene = EmbeddedAreas(seed=3, detail=0.2).load("Area_6_copyRoom_1")
    assert scene.group == "copyRoom"
    assert scene.box is not None
    assert np.array_equal(scene.box, room_box("Area_6_copyRoom_1", 3))
    with pytest.raises(InputError, match="no scene 'Area_6_office_38'"):
        EmbeddedAreas().load("Area_6_office_38")

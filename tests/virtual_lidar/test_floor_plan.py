"""Free and occupied space of a floor plan."""

import numpy as np
import pytest

from virtual_lidar.scenes.furnishing import FloorPlan, footprint, square
from virtual_lidar.scenes.surfaces import pose

L_SHAPE = np.array([(0.0, 0.0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)])


@pytest.mark.parametrize(
    ("x", "y", "half", "inside"),
    [
        (1, 1, 0.5, True),
        (3, 3, 0.5, False),
        (2, 2, 0.5, False),
        (3.4, 1, 0.6, True),
        (3.5, 1, 0.7, False),
    ],
)
def test_a_room_contains_rectangles_within_its_walls(
    x: float, y: float, half: float, inside: bool
) -> None:
    assert FloorPlan(L_SHAPE).contains(square(x, y, half)) is inside


def test_occupied_space_is_free_above() -> None:
    plan = FloorPlan(L_SHAPE)
    plan.occupy(square(1, 1, 0.4), 0.0, 0.8)
    assert not plan.is_free(square(1.3, 1, 0.2), 0.0, 0.5)
    assert plan.is_free(square(1.3, 1, 0.2), 0.9, 1.5)
    assert plan.is_free(square(1.9, 1, 0.4), 0.0, 0.5)


def test_a_rotated_rectangle_is_not_replaced_by_its_bounding_box() -> None:
    plan = FloorPlan(L_SHAPE)
    plan.occupy(footprint((-1.2, -0.05), (1.2, 0.05), pose(1.4, 1.4, turn=45)), 0.0, 1.0)
    corner = square(1.9, 0.9, 0.15)
    assert plan.is_free(corner, 0.0, 1.0)
    plan.occupy(footprint((-0.9, -0.9), (0.9, 0.9), pose(1.4, 1.4)), 0.0, 1.0)
    assert not plan.is_free(corner, 0.0, 1.0)

from dataclasses import replace

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.mesh import Mesh
from tests.support.sensor_scenes import ROOM, box, joined, moved, room, wall
from virtual_lidar import free_origin


def bare(mesh: Mesh) -> Mesh:
    return replace(mesh, labels=None)


def test_an_empty_rooms_origin_is_its_middle_at_the_given_height() -> None:
    assert free_origin(room()) == pytest.approx([3, 2.5, 1.3], abs=1e-6)
    assert free_origin(room(), height=2)[2] == pytest.approx(2, abs=1e-6)


def test_the_sensor_steps_aside_from_a_column() -> None:
    column = box([2.8, 2.3, 0], [0.4, 0.4, 3])
    origin = free_origin(joined([bare(room()), bare(column)]))
    gap = np.linalg.norm(np.maximum(np.abs(origin[:2] - [3, 2.5]) - 0.2, 0))
    assert 0.3 <= gap < 0.4
    assert origin[2] == pytest.approx(1.3, abs=1e-6)


def test_the_sensor_steps_aside_alike_in_a_far_scene() -> None:
    column, far = box([2.8, 2.3, 0], [0.4, 0.4, 3]), np.array([1e4, 2e4, 100.0])
    scene = joined([bare(room()), bare(column)])
    assert free_origin(moved(scene, far)) - far == pytest.approx(free_origin(scene), abs=1e-5)


def test_more_than_the_given_share_of_directions_has_to_meet_the_scene() -> None:
    assert free_origin(room(), inside=0.99) == pytest.approx([3, 2.5, 1.3], abs=1e-6)
    with pytest.raises(InputError, match="no free position"):
        free_origin(room(), inside=1.0)


def test_height_counts_from_the_floors_upper_side() -> None:
    slab = box([0, 0, -0.3], [6, 5, 0.3])
    scene = joined([bare(room()), bare(slab)])
    assert free_origin(scene)[2] == pytest.approx(1.3, abs=1e-6)


def test_a_low_table_in_the_middle_does_not_lift_the_sensor() -> None:
    table = box([2, 1.5, 0], [2, 2, 0.8])
    assert free_origin(joined([bare(room()), bare(table)])) == pytest.approx(
        [3, 2.5, 1.3], abs=1e-6
    )


def test_an_l_shaped_plans_middle_may_lie_outside() -> None:
    """Two boxes make an L whose bounding box has its middle outside of both."""
    scene = joined([bare(box([0, 0, 0], [6, 1.5, 3])), bare(box([0, 1.5, 0], [1.5, 4.5, 3]))])
    x, y, _ = free_origin(scene)
    assert (y <= 1.2 + 1e-6) or (x <= 1.2 + 1e-6)


def test_a_far_scene_is_no_trouble() -> None:
    far = np.array([1e5, 2e5, 100.0])
    assert free_origin(moved(room(), far)) - far == pytest.approx([3, 2.5, 1.3], abs=1e-5)


@pytest.mark.parametrize(
    "scene",
    [wall(5.0, half=3), box([0, 0, 0], ROOM * [1, 1, 0.3]), box([0, 0, 0], [0.5, 6, 3])],
    ids=["no inside", "too low", "too narrow"],
)
def test_no_free_spot_is_an_error(scene: Mesh) -> None:
    with pytest.raises(InputError, match=r"no free position 1\.3 m above its floor"):
        free_origin(scene)

"""Images compared with the camera's geometry."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.errors import InputError
from puckbench.geometry.rendering import Image, View, render_cloud

FROM_ABOVE = View(np.array([0.0, 0.0, 5.0]), np.zeros(3), 4.0, up=(0.0, 1.0, 0.0))


def covered(image: Image) -> NDArray[np.bool_]:
    return np.asarray((image < 250).any(axis=-1))


def test_the_nearer_point_hides_the_farther_one_in_any_order() -> None:
    points = np.array([[0.0, 0, 0], [0, 0, 1]])
    colours = np.array([[255, 0, 0], [0, 0, 255]], dtype=np.uint8)
    for order in ([0, 1], [1, 0]):
        image = render_cloud(
            points[order], colours[order], FROM_ABOVE, (41, 41), radius=2, shade=False
        )
        assert image[20, 20].tolist() == [0, 0, 255]


def test_splat_of_radius_two_has_thirteen_pixels() -> None:
    image = render_cloud(np.zeros((1, 3)), None, FROM_ABOVE, (41, 41), radius=2, shade=False)
    assert covered(image).sum() == 13


def test_points_behind_the_camera_are_not_drawn() -> None:
    assert not covered(render_cloud(np.array([[0.0, 0, 9]]), None, FROM_ABOVE, (41, 41))).any()


def test_the_corners_of_an_image_are_half_its_height_from_the_middle() -> None:
    projected = FROM_ABOVE.project(np.array([[0.0, 0, 1], [3, 2, 0], [-3, -2, 0]]), 600, 400)
    np.testing.assert_allclose(projected, [[300, 200, 4], [600, 0, 5], [0, 400, 5]])


def test_view_along_its_up_direction_is_refused() -> None:
    with pytest.raises(InputError, match="up"):
        View(np.array([0.0, 0.0, 1.0]), np.zeros(3), 1.0).axes()

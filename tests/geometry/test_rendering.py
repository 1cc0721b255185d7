"""Images compared with the camera's geometry."""

import numpy as np
import pytest
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.rendering import (
    Image,
    View,
    render_cloud,
    three_quarter_view,
)

FROM_ABOVE = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), height=4.0)


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
    view = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    assert not covered(render_cloud(np.array([[0.0, 0, 9]]), None, view, (41, 41))).any()


def test_a_view_shows_the_whole_box() -> None:
    bounds = np.array([[-2.0, 1.0, 0.0], [7.0, 3.0, 2.5]])
    corners = np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)
    projected = three_quarter_view(bounds).project(corners, 400, 300)
    assert (projected[:, :2] >= 0).all()
    assert (projected[:, :2] <= [400, 300]).all()


def test_view_along_its_up_direction_is_refused() -> None:
    with pytest.raises(InputError, match="up"):
        View((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)).axes()

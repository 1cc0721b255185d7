"""Pictures against what the camera's geometry says must be in each pixel."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.geometry.rendering import (
    Image,
    View,
    render_cloud,
    render_mesh,
    three_quarter_view,
    tile,
    top_view,
)

SQUARE = Mesh(
    np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
)
RED = np.array([[255, 0, 0], [255, 0, 0]], dtype=np.uint8)
FROM_ABOVE = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), height=4.0)
FROM_BELOW = View((0.0, 0.0, -5.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), height=4.0)


def covered(image: Image) -> NDArray[np.bool_]:
    return np.asarray((image < 250).any(axis=-1))


@pytest.mark.parametrize("height", [None, 4.0])
def test_rays_and_projection_are_inverse(height: float | None) -> None:
    view = View((3.0, -2.0, 1.5), (0.2, 0.1, 0.4), height=height)
    origins, directions = view.rays(64, 48)
    points = (origins + 2.5 * directions)[30, 10][None]
    assert view.project(points, 64, 48)[0, :2] == pytest.approx([10.5, 30.5])


def test_orthographic_square_covers_a_quarter_of_the_picture() -> None:
    image = render_mesh(SQUARE, FROM_ABOVE, (40, 40), RED, edges=False)
    assert covered(image).sum() == 20 * 20
    assert covered(image)[10:30, 10:30].all()
    assert image[20, 20, 0] > 100
    assert image[20, 20, 1:].max() == 0


def test_culling_removes_faces_seen_from_behind() -> None:
    assert covered(render_mesh(SQUARE, FROM_BELOW, (40, 40), RED)).any()
    assert not covered(render_mesh(SQUARE, FROM_BELOW, (40, 40), RED, cull=True)).any()
    assert covered(render_mesh(SQUARE, FROM_ABOVE, (40, 40), RED, cull=True)).any()


def test_rendering_is_deterministic() -> None:
    view = three_quarter_view(SQUARE.bounds())
    first, second = (render_mesh(SQUARE, view, (60, 40), "plain") for _ in range(2))
    assert np.array_equal(first, second)


def test_nearer_point_hides_the_farther_one_whatever_their_order() -> None:
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


@pytest.mark.parametrize("make", [three_quarter_view, top_view])
def test_views_show_the_whole_box(make: Callable[[Floats], View]) -> None:
    bounds = np.array([[-2.0, 1.0, 0.0], [7.0, 3.0, 2.5]])
    corners = np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)
    projected = make(bounds).project(corners, 400, 300)
    assert (projected[:, :2] >= 0).all()
    assert (projected[:, :2] <= [400, 300]).all()


def test_unknown_colouring_is_refused() -> None:
    with pytest.raises(InputError, match="rainbow"):
        render_mesh(SQUARE, FROM_ABOVE, (8, 8), "rainbow")


def test_view_along_its_up_direction_is_refused() -> None:
    with pytest.raises(InputError, match="up"):
        View((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)).axes()


def test_tile_places_images_row_by_row() -> None:
    sheet = tile([np.full((2, 3, 3), value, dtype=np.uint8) for value in (10, 20, 30)], 2, gap=1)
    assert sheet.shape == (5, 7, 3)
    assert [sheet[0, 0, 0], sheet[0, 4, 0], sheet[3, 0, 0], sheet[3, 4, 0]] == [10, 20, 30, 255]

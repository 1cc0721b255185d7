"""Distortion against surfaces whose distance is known in closed form."""

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.seeding import generator
from puckbench.geometry.closest import SearchableMesh, closest_surface_points, mesh_in_frame
from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud, distortion
from puckbench.metrics.truth import Truth, truth_distortion

FLOOR = Mesh(
    np.array([[0.0, 0, 0], [8, 0, 0], [8, 8, 0], [0, 8, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
)
SEEN = PointCloud(np.array([[1.0, 1, 0], [7, 7, 0]]), np.array([[0.0, 0, 1], [0, 0, 1]]))


def test_decoded_points_between_visible_ones_are_measured_to_the_surface() -> None:
    decoded = np.array([[4.0, 2, 0.5], [2, 4, -0.5]])
    values = truth_distortion(SEEN, FLOOR, decoded)
    assert values["truth_acd_ba_point"] == values["truth_acd_ba_plane"] == 0.25
    assert values["truth_acd_ab_point"] == (10.25 + 34.25) / 2
    assert values["truth_acd_ab_plane"] == 0.25
    assert values["truth_cd_plane"] == 0.25
    assert values["truth_hausdorff_plane"] == 0.5
    assert values["truth_hausdorff_point"] == 34.25**0.5


def test_beside_the_surface_the_error_to_plane_is_less_than_to_point() -> None:
    values = truth_distortion(SEEN, FLOOR, np.array([[-3.0, 4, 4]]))
    assert values["truth_acd_ba_point"] == 25
    assert values["truth_acd_ba_plane"] == 16


def test_over_a_tilted_surface_the_error_to_plane_is_the_squared_height_over_it() -> None:
    """Over the plane z = 3/4 x, whose unit normal is (-3, 0, 4) / 5."""
    slope = Mesh(FLOOR.vertices + FLOOR.vertices[:, [2, 2, 0]] * [0, 0, 0.75], FLOOR.triangles)
    normal = np.array([-0.6, 0, 0.8])
    seen = PointCloud(np.array([[4.0, 4, 3]]), normal[None])
    values = truth_distortion(seen, slope, np.array([4.0, 4, 3]) + normal * [[0.5], [-1.5]])
    assert values["truth_acd_ba_plane"] == pytest.approx((0.5**2 + 1.5**2) / 2)
    assert values["truth_hausdorff_plane"] == pytest.approx(1.5)


def test_without_a_mesh_the_visible_points_are_the_truth() -> None:
    decoded = generator(1, "decoded").random((50, 3)) * 8
    ordinary = distortion(SEEN, decoded)
    assert truth_distortion(SEEN, None, decoded) == {f"truth_{k}": v for k, v in ordinary.items()}


def test_a_scan_at_an_offset_is_as_far_from_the_clean_scan_along_and_across_the_surface() -> None:
    x, y = np.meshgrid(np.arange(1.0, 8), np.arange(1.0, 8))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    clean = PointCloud(points, np.tile([0.0, 0, 1], (len(points), 1)))
    values = truth_distortion(clean, FLOOR, points + np.array([0.25, 0, 0.5]), is_scan=True)
    for kind in ("acd_ab", "acd_ba", "cd"):
        assert values[f"truth_{kind}_plane"] == values[f"clean_{kind}_plane"] == 0.25
        assert values[f"clean_{kind}_point"] == 0.25**2 + 0.5**2
    assert values["truth_acd_ba_point"] == 0.25  # between the rays there is surface, and no point
    assert values["truth_acd_ab_point"] == values["clean_acd_ab_point"]
    assert values["truth_points_a"] == values["truth_points_b"] == len(points)
    assert "clean_points_a" not in values


def test_without_true_normals_there_is_nothing_to_plane() -> None:
    values = truth_distortion(PointCloud(SEEN.xyz), FLOOR, np.array([[4.0, 2, 0.5]]))
    assert "truth_cd_point" in values
    assert not [key for key in values if "plane" in key]


@pytest.mark.parametrize(
    ("point", "closest"),
    [
        ([2, 1, 3], [2, 1, 0]),
        ([2, -1, 1], [2, 0, 0]),
        ([-1, -2, 1], [0, 0, 0]),
        ([9, 9, 0], [8, 8, 0]),
        ([10, 3, 0], [8, 3, 0]),
    ],
)
def test_closest_point_over_a_face_an_edge_and_a_corner(
    point: list[float], closest: list[float]
) -> None:
    nearest = closest_surface_points(FLOOR, np.array([point], dtype=np.float64))
    np.testing.assert_array_equal(nearest.xyz, [closest])
    np.testing.assert_array_equal(nearest.normals, [[0, 0, 1]])


def test_closest_points_are_exact_far_from_the_origin() -> None:
    away = np.array([40_000.0, -30_000.0, 500.0])
    points = generator(2, "above").random((100, 3)) * [8, 8, 1]
    far = Mesh(FLOOR.vertices + away, FLOOR.triangles)
    nearest = closest_surface_points(far, points + away)
    np.testing.assert_allclose(nearest.xyz - away, points * [1, 1, 0], atol=1e-10)


def test_points_off_a_sphere_are_its_radius_less_away() -> None:
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=5)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces, dtype=np.int64))
    corners = mesh.vertices[::50]
    nearest = closest_surface_points(mesh, corners * 1.5)
    np.testing.assert_allclose(nearest.xyz, corners, atol=1e-15)


def test_triangles_without_area_are_left_out() -> None:
    triangles = np.array([[0, 0, 1], [0, 1, 2], [0, 2, 3]])
    nearest = closest_surface_points(Mesh(FLOOR.vertices, triangles), np.array([[4.0, 0, 1]]))
    assert nearest.triangles.tolist() == [1]
    np.testing.assert_array_equal(nearest.normals, [[0, 0, 1]])


def test_a_mesh_is_brought_into_the_frame_of_a_scaled_cloud() -> None:
    cloud = PointCloud(np.zeros((1, 3)), about={"scale": 170.5, "offset": [-1.0, 2.0, 0.5]})
    moved = mesh_in_frame(FLOOR, cloud.about["scale"], cloud.about["offset"])
    np.testing.assert_allclose(cloud.to_metres(moved.vertices), FLOOR.vertices, atol=1e-12)


def rough_floor() -> Mesh:
    """A grid of 800 triangles whose corners are lifted at random."""
    x, y = np.meshgrid(np.arange(21.0), np.arange(21.0))
    vertices = np.column_stack([x.ravel(), y.ravel(), generator(3, "rough").random(x.size)])
    first = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel()
    squares = first[:, None] + [[0, 1, 22, 0, 22, 21]]
    return Mesh(vertices, squares.reshape(-1, 3))


def test_one_surface_and_one_reference_give_the_values_of_one_off_calls() -> None:
    mesh, random = rough_floor(), generator(4, "above")
    surface = SearchableMesh(mesh)
    for number in (1, 300, 7, 300):
        points = random.random((number, 3)) * [24, 24, 2] - 2
        once, twice = closest_surface_points(mesh, points), closest_surface_points(surface, points)
        np.testing.assert_array_equal(once.xyz, twice.xyz)
        np.testing.assert_array_equal(once.normals, twice.normals)
        np.testing.assert_array_equal(once.triangles, twice.triangles)
        for scan in (False, True):
            again = ReferenceCloud(SEEN), surface, DistinctPoints(points)
            assert truth_distortion(*again, scan) == truth_distortion(SEEN, mesh, points, scan)


@pytest.mark.parametrize(
    ("surface", "seen", "clean"),
    [
        (rough_floor(), None, None),
        (rough_floor(), SEEN, None),
        (rough_floor(), None, SEEN),
        (SEEN, None, None),
        (None, SEEN, None),
        (None, None, SEEN),
    ],
)
def test_one_truth_gives_many_decoded_clouds_the_values_of_one_off_calls(
    surface: Mesh | PointCloud | None, seen: PointCloud | None, clean: PointCloud | None
) -> None:
    cloud = PointCloud(np.zeros((50, 3)), about={"scale": 10.0, "offset": [1.0, 2.0, 3.0]})
    truth, random = Truth(cloud, surface, seen, clean), generator(5, "decoded")
    for number in (200, 20, 200):
        decoded = random.random((number, 3)) * 200
        expected = Truth(cloud, surface, seen, clean).metrics(decoded)
        assert truth.metrics(decoded) == truth.metrics(DistinctPoints(decoded)) == expected

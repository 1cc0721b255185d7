"""All geometry_metrics of a decoded cloud at once, on clouds whose errors are known."""

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Mesh
from puckbench.metrics.cloud_metrics import attribute_metrics, geometry_metrics, picture_metrics
from puckbench.metrics.default_peak import PEAK_M
from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud
from puckbench.metrics.truth import Truth

GRID = np.stack(np.meshgrid(*[np.arange(12.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)
UP = np.tile([0.0, 0, 1], (len(GRID), 1))
RAISED = GRID + np.array([0, 0, 0.5])
ABOUT = {"scale": 10.0, "offset": [1.0, 2.0, 3.0], "size": 1024}
FLOOR_M = Mesh(
    np.array([[0.0, 0, 3], [9, 0, 3], [9, 9, 3], [0, 9, 3]]), np.array([[0, 1, 2], [0, 2, 3]])
)
"""The plane of the grid in metres, 3 m above the origin."""


def test_a_raised_grid_in_decibels_and_metres() -> None:
    """Half a grid unit is 5 cm; the grid's diagonal is its diameter."""
    values = geometry_metrics(PointCloud(GRID, UP, about=ABOUT), RAISED)
    assert values["d1_mse"] == values["d2_mse"] == 0.25
    assert values["d1_psnr"] == pytest.approx(10 * np.log10(3 * 1023**2 / 0.25))
    assert values["cd_psnr_point"] == pytest.approx(10 * np.log10(11**2 * 2 / 0.25))
    assert values["d1_rms_m"] == values["hausdorff_plane_m"] == pytest.approx(0.05)


def test_peak_and_diameter_may_be_given() -> None:
    wide = PointCloud(GRID, about={**ABOUT, "diameter": 100.0})
    values = geometry_metrics(wide, RAISED, peak=100.0)
    assert values["d1_psnr"] == pytest.approx(10 * np.log10(3 * 100**2 / 0.25))
    assert values["cd_psnr_point"] == pytest.approx(10 * np.log10(100**2 / 0.25))
    assert "d2_psnr" not in values


def test_a_sensors_cloud_in_square_millimetres_and_a_peak_of_30_m() -> None:
    """Half a centimetre is 25 mm^2; MPEG's peak for such data is 30,000 units of 1 mm."""
    about = {"scale": 1.0, "offset": [0.0, 0, 0], "size": 0, "peak": PEAK_M}
    values = geometry_metrics(PointCloud(GRID, UP, about=about), GRID + np.array([0, 0, 0.005]))
    assert values["d1_mm2"] == pytest.approx(25)
    assert values["d2_mm2"] == pytest.approx(25)
    assert values["d1_psnr"] == pytest.approx(10 * np.log10(3 * 30_000**2 / 25))
    assert "d1_mm2" not in geometry_metrics(PointCloud(GRID, UP, about=ABOUT), RAISED)


def test_a_psnr_without_a_peak_or_an_error_is_left_out() -> None:
    unknown = geometry_metrics(PointCloud(GRID), RAISED)
    assert "d1_psnr" not in unknown
    assert unknown["d1_rms_m"] == 0.5
    assert not [
        name for name in geometry_metrics(PointCloud(GRID, about=ABOUT), GRID) if "psnr" in name
    ]


def test_one_reference_gives_many_decoded_clouds_the_measures_of_one_off_calls() -> None:
    for cloud in (PointCloud(GRID, UP, about=ABOUT), PointCloud(GRID)):
        reference = ReferenceCloud(cloud)
        for decoded in (RAISED, GRID[::5] + 0.25, RAISED):
            assert geometry_metrics(reference, decoded) == geometry_metrics(cloud, decoded)
            assert geometry_metrics(reference, decoded, peak=9) == geometry_metrics(
                cloud, decoded, peak=9
            )
            assert geometry_metrics(cloud, DistinctPoints(decoded)) == geometry_metrics(
                cloud, decoded
            )


def test_pictures_and_colours_are_measured_where_there_are_some() -> None:
    grey = np.full((len(GRID), 3), 100, np.uint8)
    plain, coloured = PointCloud(GRID), PointCloud(GRID, colours=grey)
    for pair in ((plain, plain), (plain, coloured), (coloured, plain)):
        assert attribute_metrics(*pair, {}) == {}
    both = attribute_metrics(coloured, coloured, {"cd_plane": 2.0})
    assert both["joint_quality"] == pytest.approx(0.6597 * 2)
    assert "y_psnr" not in both
    assert picture_metrics(plain, plain, 0) == {}
    assert picture_metrics(plain, PointCloud(RAISED[1:]), 32)["view_pixels"] == 32


def test_the_true_surface_is_a_mesh_in_metres_or_points_in_the_cloud_s_frame() -> None:
    """The grid lies on the floor; decoded points half a unit, 5 cm, above it."""
    reference = PointCloud(GRID, about=ABOUT)
    decoded = RAISED + np.array([0.25, 0, 0])
    for visible in ({"seen": PointCloud(GRID, UP), "clean": None}, {"seen": None, "clean": None}):
        values = Truth(reference, FLOOR_M, **visible).metrics(decoded)
        assert values["truth_acd_ba_plane"] == pytest.approx(0.25)
        assert values["truth_acd_ba_point"] == pytest.approx(0.25)
        assert values["truth_points_a"] == len(GRID)
    surface = PointCloud(GRID, UP)
    points = Truth(reference, surface).metrics(decoded)
    assert points["truth_acd_ba_point"] == pytest.approx(0.25 + 0.0625)
    assert points["truth_hausdorff_plane_m"] == pytest.approx(0.05)
    some = Truth(reference, surface, PointCloud(GRID[:9], UP[:9])).metrics(decoded)
    assert some["truth_points_a"] == 9


def test_a_clean_scan_is_compared_as_well() -> None:
    clean = PointCloud(GRID, UP)
    values = Truth(PointCloud(GRID), None, PointCloud(GRID[:9]), clean).metrics(RAISED)
    assert values["truth_points_a"] == len(GRID)
    assert values["clean_acd_ba_plane"] == values["truth_acd_ba_plane"] == 0.25


def test_without_a_scale_units_are_metres_at_the_origin() -> None:
    flat = Mesh(FLOOR_M.vertices - [0, 0, 3], FLOOR_M.triangles)
    values = Truth(PointCloud(GRID[:5]), flat).metrics(RAISED[:5])
    assert values["truth_d2_rms_m"] == pytest.approx(0.5)
    assert values["truth_points_a"] == 5
    corners = np.array([[0.0, 0, 0.5], [9, 9, 0.5]])
    assert Truth(PointCloud(GRID), flat).metrics(corners)["truth_acd_ba_point"] == 0.25

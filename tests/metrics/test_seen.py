"""Pictures, colours, density and elongation, against closed forms and direct formulas."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from scipy.spatial.distance import cdist

from puckbench.cli import main
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import write_cloud
from puckbench.metrics.colour import (
    colour_distortion,
    joint_quality,
    yuv,
)
from puckbench.metrics.density import density, in_metres
from puckbench.metrics.elongation import elongation, oriented_elongation
from puckbench.metrics.ssim import ssim
from puckbench.metrics.views import view, view_quality

CORNERS = np.array([[0.0, 0, 0], [100, 100, 100]])
GRID = np.stack(np.meshgrid(*[np.arange(12.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)


def test_ssim_is_the_paper_s_sum_over_windows() -> None:
    rng = np.random.default_rng(1)
    a = rng.uniform(0, 255, (13, 14))
    b = np.clip(a + rng.normal(0, 40, a.shape), 0, 255)
    at = np.arange(-5, 6)
    weight = np.exp(-(at[:, None] ** 2 + at**2) / (2 * 1.5**2))
    weight /= weight.sum()
    values = []
    for row in range(3):
        for column in range(4):
            x, y = (image[row : row + 11, column : column + 11] for image in (a, b))
            mx, my = (weight * x).sum(), (weight * y).sum()
            vx, vy = (weight * (x - mx) ** 2).sum(), (weight * (y - my) ** 2).sum()
            cov = (weight * (x - mx) * (y - my)).sum()
            c1, c2 = 2.55**2, 7.65**2
            top = (2 * mx * my + c1) * (2 * cov + c2)
            values.append(top / ((mx**2 + my**2 + c1) * (vx + vy + c2)))
    assert ssim(a, b) == pytest.approx(np.mean(values), rel=1e-12)
    assert ssim(a, a) == pytest.approx(1)


def test_a_view_shows_the_nearest_point_in_the_right_pixel() -> None:
    # 104 pixels for 104 units: a pixel per unit, and the box begins at pixel 2.
    points = np.array([[0.0, 20.5, 70.5], [50, 20.5, 70.5], [100, 20.5, 70.5]])
    front = view(PointCloud(points), 0, CORNERS, 104, 0, coloured=False)
    back = view(PointCloud(points), 1, CORNERS, 104, 0, coloured=False)
    assert np.argwhere(front < 255).tolist() == [[31, 22]]
    assert front[31, 22] == 0
    assert np.argwhere(back < 255).tolist() == [[31, 81]]
    assert back[31, 81] == 0
    middle = view(PointCloud(points[:2]), 0, CORNERS, 104, 0, coloured=False)
    assert middle[31, 22] == 100


def test_views_have_the_error_that_one_lost_point_makes() -> None:
    reference = PointCloud(np.vstack([CORNERS, [[50.0, 50, 50]]]))
    decoded = PointCloud(reference.xyz[:2])
    found = view_quality(reference, decoded, 104, radius=0)
    # In each picture one pixel of grey 100 becomes white, if no corner hides it.
    mse = (255 - 100) ** 2 / 104**2
    assert found["view_psnr"] == pytest.approx(10 * np.log10(255**2 / mse))
    assert 0.9 < found["view_ssim"] < 1
    same = view_quality(reference, reference, 104, radius=0)
    assert np.isinf(same["view_psnr"])
    assert same["view_ssim"] == pytest.approx(1)
    with pytest.raises(InputError, match="5 pixels are fewer"):
        view_quality(reference, decoded, 5)


def coloured(points: np.ndarray, rgb: tuple[int, int, int]) -> PointCloud:
    return PointCloud(points, colours=np.tile(np.array(rgb, np.uint8), (len(points), 1)))


def test_luminance_and_chrominance_are_those_of_bt_709() -> None:
    values = yuv(np.array([[255, 255, 255], [255, 0, 0], [0, 0, 255]], np.uint8))
    expected = [[1, 0, 0], [0.2126, -0.1146, 0.5], [0.0722, 0.5, -0.0458]]
    np.testing.assert_allclose(values, expected, atol=1e-12)


def test_grey_levels_apart_are_an_error_of_luminance_alone() -> None:
    found = colour_distortion(coloured(GRID, (100, 100, 100)), coloured(GRID, (151, 151, 151)))
    assert found["y_psnr"] == pytest.approx(20 * np.log10(5))
    assert found["u_mse"] == pytest.approx(0, abs=1e-20)
    assert found["luminance_l2"] == pytest.approx(2**0.5)
    joint = joint_quality({"cd_plane": 2.0}, found)
    assert joint == pytest.approx(0.6597 * 2 + 0.3403 * 2**0.5)


def test_duplicates_and_equidistant_neighbours_count_with_their_mean_colour() -> None:
    ends = np.array([[0.0, 0, 0], [2, 0, 0]])
    reference = PointCloud(ends, colours=np.array([[0] * 3, [100] * 3], np.uint8))
    middle = coloured(np.array([[1.0, 0, 0]]), (50, 50, 50))
    # From the middle point no error; from the ends 50 grey levels.
    assert colour_distortion(reference, middle)["y_psnr"] == pytest.approx(20 * np.log10(5.1))
    twice = PointCloud(np.zeros((2, 3)), colours=np.array([[40] * 3, [60] * 3], np.uint8))
    once = coloured(np.zeros((1, 3)), (50, 50, 50))
    assert colour_distortion(twice, once)["y_mse"] == pytest.approx(0, abs=1e-20)
    with pytest.raises(InputError, match="decoded cloud: no colour"):
        colour_distortion(reference, PointCloud(ends))


def test_the_density_of_a_grid_and_its_outlier() -> None:
    points = np.vstack([GRID, GRID[:1], [[200.0, 0, 0]]])
    found = density(points)
    assert found["duplicates"] == pytest.approx(1 / 146)
    assert found["spacing_median"] == 1
    assert found["outliers"] == pytest.approx(1 / 145)
    # The 16th neighbour in the grid's middle is at sqrt 5 (4 + 4 + 4 nearer ones).
    assert found["density_q95"] == pytest.approx(16 / (5 * np.pi))
    metres = in_metres(found, 10.0)
    assert metres["spacing_median_m"] == pytest.approx(0.1)
    assert metres["density_q95_m2"] == pytest.approx(1600 / (5 * np.pi))
    assert density(np.zeros((4, 3))) == {"duplicates": 0.75}


def test_density_is_that_of_all_pairs() -> None:
    """Of 201 values in order, the 11th and the 191st are the quantiles 0.05 and 0.95."""
    points = np.random.default_rng(5).standard_t(3, (201, 3))
    pairs = np.sort(cdist(points, points), axis=1)[:, 1:17]
    found = density(points)
    for name, values in (("spacing", pairs[:, 0]), ("density", 16 / (np.pi * pairs[:, -1] ** 2))):
        low, middle, high = np.sort(values)[[10, 100, 190]]
        assert found[f"{name}_q05"] == pytest.approx(low, rel=1e-12)
        assert found[f"{name}_median"] == pytest.approx(middle, rel=1e-12)
        assert found[f"{name}_q95"] == pytest.approx(high, rel=1e-12)


def test_outliers_are_two_standard_deviations_beyond_the_mean() -> None:
    points = np.random.default_rng(6).standard_t(3, (201, 3))
    means = np.sort(cdist(points, points), axis=1)[:, 1:17].mean(axis=1)
    beyond = (means - means.mean()) / means.std()
    assert len({np.mean(beyond > limit) for limit in (1.9, 2, 2.1)}) == 3
    assert density(points)["outliers"] == np.mean(beyond > 2)


def test_elongation_of_a_turned_box() -> None:
    rng = np.random.default_rng(2)
    box = rng.uniform(0, 1, (20_000, 3)) * [8, 4, 2]
    angle = np.radians(30)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    turned = box @ turn.T
    assert elongation(box) == pytest.approx(0.25, abs=1e-3)
    assert elongation(turned) == pytest.approx(2 / (8 * np.cos(angle) + 2), abs=5e-3)
    assert oriented_elongation(turned) == pytest.approx(0.25, abs=0.06)
    oracle = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(turned))
    sides = oracle.get_oriented_bounding_box().extent
    assert oriented_elongation(turned) == pytest.approx(min(sides) / max(sides), rel=1e-6)
    assert oriented_elongation(GRID) == 0


def test_evaluate_measures_pictures_and_colours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_cloud(tmp_path / "a.ply", coloured(GRID, (100, 100, 100)))
    write_cloud(tmp_path / "b.ply", coloured(GRID + np.array([0, 0, 0.25]), (151, 151, 151)))
    words = ["evaluate", str(tmp_path / "a.ply"), str(tmp_path / "b.ply"), "--json"]
    assert main([*words, "--views", "64"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["y_psnr"] == pytest.approx(20 * np.log10(5))
    assert found["view_pixels"] == 64
    assert main(words) == 0
    assert "view_psnr" not in json.loads(capsys.readouterr().out)

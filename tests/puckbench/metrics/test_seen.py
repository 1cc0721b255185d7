"""Pictures, colours, density and elongation, against closed forms and direct formulas."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from scipy.spatial.distance import cdist

from cloud_files.clouds import write_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from puckbench.metrics import density as measured_density
from puckbench.metrics.colour import colour_distortion, joint_quality, luminance_distance, yuv
from puckbench.metrics.density import density, density_in_metres
from puckbench.metrics.elongation import elongation, oriented_elongation
from puckbench.metrics.ssim import ssim
from puckbench.metrics.views import closing_radius, view, view_metrics

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
    assert ssim(a[:11, :11], a[:11, :11]) == pytest.approx(1)
    for other in (a[:12], a.T):
        with pytest.raises(InputError, match="SSIM: images must be of one size"):
            ssim(a, other)
    with pytest.raises(InputError, match="SSIM: images must be of one size"):
        ssim(a[:10], a[:10])


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


@pytest.mark.parametrize(
    ("axis", "row", "column", "grey"),
    [
        (0, 31, 22, 179),
        (1, 31, 81, 21),
        (2, 31, 91, 159),
        (3, 31, 12, 41),
        (4, 81, 12, 59),
        (5, 81, 91, 141),
    ],
)
def test_six_views_are_upright_and_grow_brighter_with_depth(
    axis: int, row: int, column: int, grey: int
) -> None:
    """z is up, and from above and below y; twice the depth is the grey."""
    cloud = PointCloud(np.array([[10.5, 20.5, 70.5]]))
    seen = view(cloud, axis, CORNERS, 104, 0, coloured=False)
    assert np.argwhere(seen < 255).tolist() == [[row, column]]
    assert seen[row, column] == grey


def test_a_view_of_colours_shows_luminance() -> None:
    primary = 255 * np.eye(3, dtype=np.uint8)
    cloud = PointCloud(np.array([[0, 10.5, 0], [0, 20.5, 0], [0, 30.5, 0]]), colours=primary)
    seen = view(cloud, 0, CORNERS, 104, 0, coloured=True)
    assert seen[102, [12, 22, 32]].tolist() == [54, 182, 18]


def test_a_point_that_moved_out_of_the_box_is_still_seen() -> None:
    before, behind = (PointCloud(np.array([[x, 20.5, 70.5]])) for x in (190.0, -90.0))
    assert view(before, 0, CORNERS, 104, 0, coloured=False)[31, 22] == 0
    assert view(behind, 0, CORNERS, 104, 0, coloured=False)[31, 22] == 200


def test_a_single_point_is_seen_in_the_middle() -> None:
    cloud = PointCloud(np.array([[3.0, 4, 5]]))
    seen = view(cloud, 0, np.repeat(cloud.xyz, 2, axis=0), 104, 0, coloured=False)
    assert np.argwhere(seen < 255).tolist() == [[52, 52]]
    assert seen[52, 52] == 0
    assert closing_radius(cloud.xyz, 104) == 1


def test_discs_reach_twice_the_median_spacing() -> None:
    """11 units and a margin of 4 % are 100 pixels: 2 units are 17.5 of them."""
    assert closing_radius(GRID, 100) == 18
    assert closing_radius(GRID, 5) == 1
    values = view_metrics(PointCloud(GRID), PointCloud(GRID), 11)
    assert (values["view_radius"], values["view_pixels"]) == (2, 11)


def test_views_show_depth_unless_both_clouds_have_colours() -> None:
    plain, moved = PointCloud(GRID), PointCloud(GRID * 0.9)
    grey, both = coloured(GRID, (9, 9, 9)), coloured(moved.xyz, (9, 9, 9))
    depth = view_metrics(plain, moved, 32)
    assert view_metrics(grey, moved, 32) == view_metrics(plain, both, 32) == depth
    assert view_metrics(grey, both, 32) != depth


def test_views_have_the_error_that_one_lost_point_makes() -> None:
    reference = PointCloud(np.vstack([CORNERS, [[50.0, 50, 50]]]))
    decoded = PointCloud(reference.xyz[:2])
    values = view_metrics(reference, decoded, 104, radius=0)
    # In each picture one pixel of grey 100 becomes white, if no corner hides it.
    mse = (255 - 100) ** 2 / 104**2
    assert values["view_psnr"] == pytest.approx(10 * np.log10(255**2 / mse))
    assert 0.9 < values["view_ssim"] < 1
    same = view_metrics(reference, reference, 104, radius=0)
    assert np.isinf(same["view_psnr"])
    assert same["view_ssim"] == pytest.approx(1)
    with pytest.raises(InputError, match="5 pixels are too few"):
        view_metrics(reference, decoded, 5)


def coloured(points: np.ndarray, rgb: tuple[int, int, int]) -> PointCloud:
    return PointCloud(points, colours=np.tile(np.array(rgb, np.uint8), (len(points), 1)))


def test_luminance_and_chrominance_are_those_of_bt_709() -> None:
    values = yuv(np.array([[255, 255, 255], [255, 0, 0], [0, 0, 255]], np.uint8))
    expected = [[1, 0, 0], [0.2126, -0.1146, 0.5], [0.0722, 0.5, -0.0458]]
    np.testing.assert_allclose(values, expected, atol=1e-12)


def test_grey_levels_apart_are_an_error_of_luminance_alone() -> None:
    errors = colour_distortion(coloured(GRID, (100, 100, 100)), coloured(GRID, (151, 151, 151)))
    assert errors["y_psnr"] == pytest.approx(20 * np.log10(5))
    assert errors["u_mse"] == pytest.approx(0, abs=1e-20)
    assert errors["luminance_l2"] == pytest.approx(2**0.5)
    joint = joint_quality({"cd_plane": 2.0}, errors)
    assert joint == pytest.approx(0.6597 * 2 + 0.3403 * 2**0.5)
    assert np.isnan(joint_quality({"cd_point": 2.0}, errors))
    same = colour_distortion(coloured(GRID, (100, 100, 100)), coloured(GRID, (100, 100, 100)))
    assert same["luminance_l2"] == 0
    assert np.isinf(same["y_psnr"])


def test_luminance_is_compared_in_256_bins_from_black_to_white() -> None:
    low, high = np.array([100.1]) / 256, np.array([100.9]) / 256
    assert luminance_distance(low, high) == 0
    assert luminance_distance(low, np.array([99.9]) / 256) == pytest.approx(2**0.5)
    both = np.concatenate([low, [1.0]])
    assert luminance_distance(low, both) == pytest.approx(0.5**0.5)


def test_duplicates_and_equidistant_neighbours_count_with_their_mean_colour() -> None:
    ends = np.array([[0.0, 0, 0], [2, 0, 0]])
    reference = PointCloud(ends, colours=np.array([[0] * 3, [100] * 3], np.uint8))
    middle = coloured(np.array([[1.0, 0, 0]]), (50, 50, 50))
    # From the middle point no error; from the ends 50 grey levels.
    assert colour_distortion(reference, middle)["y_psnr"] == pytest.approx(20 * np.log10(5.1))
    twice = PointCloud(np.zeros((2, 3)), colours=np.array([[40] * 3, [60] * 3], np.uint8))
    once = coloured(np.zeros((1, 3)), (50, 50, 50))
    assert colour_distortion(twice, once)["y_mse"] == pytest.approx(0, abs=1e-20)
    with pytest.raises(InputError, match="decoded cloud: needs a colour"):
        colour_distortion(reference, PointCloud(ends))


def test_the_density_of_a_grid_and_its_outlier() -> None:
    points = np.vstack([GRID, GRID[:1], [[200.0, 0, 0]]])
    values = density(points)
    assert values["duplicates"] == pytest.approx(1 / 146)
    assert values["spacing_median"] == 1
    assert values["outliers"] == pytest.approx(1 / 145)
    # The 16th neighbour in the grid's middle is at sqrt 5 (4 + 4 + 4 nearer ones).
    assert values["density_q95"] == pytest.approx(16 / (5 * np.pi))
    metres = density_in_metres(values, 10.0)
    assert metres["spacing_median_m"] == pytest.approx(0.1)
    assert metres["density_q95_m2"] == pytest.approx(1600 / (5 * np.pi))
    assert density(np.zeros((4, 3))) == {"duplicates": 0.75}


def test_density_is_that_of_all_pairs() -> None:
    """Of 201 values in order, the 11th and the 191st are the quantiles 0.05 and 0.95."""
    points = np.random.default_rng(5).standard_t(3, (201, 3))
    pairs = np.sort(cdist(points, points), axis=1)[:, 1:17]
    statistics = density(points)
    for name, values in (("spacing", pairs[:, 0]), ("density", 16 / (np.pi * pairs[:, -1] ** 2))):
        low, middle, high = np.sort(values)[[10, 100, 190]]
        assert statistics[f"{name}_q05"] == pytest.approx(low, rel=1e-12)
        assert statistics[f"{name}_median"] == pytest.approx(middle, rel=1e-12)
        assert statistics[f"{name}_q95"] == pytest.approx(high, rel=1e-12)


def test_few_points_have_the_density_of_those_that_there_are() -> None:
    """Two points at a distance of 2: one neighbour within a disc of radius 2."""
    values = density(np.array([[0.0, 0, 0], [2, 0, 0], [2, 0, 0]]))
    assert values["duplicates"] == pytest.approx(1 / 3)
    assert values["spacing_median"] == 2
    assert values["density_median"] == pytest.approx(1 / (4 * np.pi))
    assert values["outliers"] == 0
    line = density(np.arange(5.0)[:, None] * [1, 0, 0])
    assert line["density_q95"] == pytest.approx(4 / np.pi * np.quantile([1 / 4, 1 / 9], 0.8))


def test_of_many_points_some_are_measured_each_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without one of 201 points, a quantile moves by no more than one place."""
    points = np.random.default_rng(5).standard_t(3, (201, 3))
    spacing = np.sort(np.sort(cdist(points, points), axis=1)[:, 1])
    monkeypatch.setattr(measured_density, "QUERIES", 200)
    values = density(points)
    for name, place in (("q05", 10), ("median", 100), ("q95", 190)):
        assert spacing[place - 1] <= values[f"spacing_{name}"] <= spacing[place + 1]
    assert values["spacing_q05"] not in spacing
    assert density(points) == values


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
    assert elongation(np.zeros((1, 3))) == 0
    assert elongation(np.array([[0.0, 0, 0], [0.2, 0.4, 0.8]])) == pytest.approx(0.25)


def test_evaluate_measures_pictures_and_colours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_cloud(tmp_path / "a.ply", coloured(GRID, (100, 100, 100)))
    write_cloud(tmp_path / "b.ply", coloured(GRID + np.array([0, 0, 0.25]), (151, 151, 151)))
    words = ["evaluate", str(tmp_path / "a.ply"), str(tmp_path / "b.ply"), "--json"]
    assert main([*words, "--views", "64"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["y_psnr"] == pytest.approx(20 * np.log10(5))
    assert answer["view_pixels"] == 64
    assert main(words) == 0
    assert "view_psnr" not in json.loads(capsys.readouterr().out)

"""Distortion against MPEG's pc_error (stored output), brute force and closed forms."""

import json
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.seeding import generator
from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud, distortion, squared_errors
from puckbench.metrics.psnr import mpeg_psnr

DATA = Path(__file__).parents[2] / "data" / "pc_error"
EXPECTED = json.loads((DATA / "expected.json").read_text())["values"]


def load_pair(name: str) -> tuple[PointCloud, Floats]:
    with np.load(DATA / f"{name}.npz") as pair:
        values = {key: pair[key].astype(np.float64) for key in pair.files}
    return PointCloud(values["reference"], values["normals"]), values["decoded"]


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_agrees_with_pc_error(name: str) -> None:
    reference, decoded = load_pair(name)
    errors = squared_errors(reference, decoded)
    measured = distortion(reference, decoded)
    psnr = mpeg_psnr(measured, 1023)
    measured |= {"psnr_point": psnr["d1_psnr"], "psnr_plane": psnr["d2_psnr"]}
    measured |= {"h1_point": errors.ab_point.max(), "h2_point": errors.ba_point.max()}
    measured |= {"h1_plane": errors.ab_plane.max(), "h2_plane": errors.ba_plane.max()}
    assert {key: measured[key] for key in EXPECTED[name]} == pytest.approx(
        EXPECTED[name], rel=1e-6, abs=1e-30
    )


def floor(size: int, step: float) -> Floats:
    x, y = np.meshgrid(np.arange(size) * step, np.arange(size) * step)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def up(points: Floats) -> Floats:
    return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def test_a_floor_raised_by_h_is_h_away_to_point_and_to_plane() -> None:
    points = floor(20, 1.0)
    values = distortion(PointCloud(points, up(points)), points + np.array([0, 0, 0.25]))
    for kind, largest in (("point", "d1_mse"), ("plane", "d2_mse")):
        names = (f"acd_ab_{kind}", f"acd_ba_{kind}", f"cd_{kind}", largest)
        assert [values[name] for name in names] == [0.0625] * 4
        assert values[f"hausdorff_{kind}"] == 0.25
        assert values[f"hausdorff_sq_{kind}"] == 0.0625


def test_a_floor_moved_within_its_plane_has_no_error_to_plane() -> None:
    points = floor(20, 1.0)
    values = distortion(PointCloud(points, up(points)), points + np.array([0.125, 0, 0]))
    assert values["cd_point"] == 0.125**2
    assert values["d2_mse"] == values["hausdorff_plane"] == 0


def test_chamfer_and_hausdorff_of_three_points_by_hand() -> None:
    reference = PointCloud(np.array([[0.0, 0, 0], [10, 0, 0]]))
    values = distortion(reference, np.array([[0.0, 3, 0]]))
    assert values["acd_ab_point"] == (9 + 109) / 2
    assert values["acd_ba_point"] == 9
    assert values["cd_point"] == (59 + 9) / 2
    assert values["d1_mse"] == 59
    assert values["hausdorff_point"] == 109**0.5
    assert "cd_plane" not in values


def test_every_one_of_many_equidistant_neighbours_counts() -> None:
    kinds = ((1, 4, 8), (4, 4, 7), (0, 0, 9), (3, 6, 6))
    sphere = {
        tuple(sign * value for sign, value in zip(signs, order, strict=True))
        for kind in kinds
        for order in permutations(kind)
        for signs in product((-1, 1), repeat=3)
    }
    assert len(sphere) == 102
    centre = PointCloud(np.zeros((1, 3)), np.array([[0.0, 0, 1]]))
    values = distortion(centre, np.array(sorted(sphere), dtype=np.float64))
    assert values["acd_ab_point"] == 81
    assert values["acd_ab_plane"] == pytest.approx(81 / 3, rel=1e-15)


def test_a_point_between_two_walls_gets_the_plain_mean_of_their_normals() -> None:
    reference = PointCloud(np.array([[1.0, 0, 0], [0, 1, 0]]), np.array([[1.0, 0, 0], [0, 1, 0]]))
    values = distortion(reference, np.zeros((1, 3)))
    assert values["acd_ab_plane"] == 0.25
    assert values["acd_ba_plane"] == 1


def test_duplicates_are_measured_once() -> None:
    reference, decoded = load_pair("sparser")
    values = distortion(reference, decoded)
    repeated = PointCloud(np.tile(reference.xyz, (2, 1)), np.tile(reference.normals, (2, 1)))
    assert distortion(repeated, np.repeat(decoded, 3, axis=0)) == values
    assert (values["points_a"], values["points_b"]) == (600, 150)


def test_clouds_without_normals_are_measured_alike_both_ways() -> None:
    reference, decoded = load_pair("grid_ties")
    there = distortion(PointCloud(reference.xyz), decoded)
    back = distortion(PointCloud(decoded), reference.xyz)
    assert there["acd_ab_point"] == back["acd_ba_point"]
    assert there["cd_point"] == back["cd_point"]
    assert there["hausdorff_point"] == back["hausdorff_point"]


def test_equal_clouds_have_no_error() -> None:
    reference, _ = load_pair("room_quantised")
    values = distortion(reference, reference.xyz[::-1])
    assert not any(value for key, value in values.items() if not key.startswith("points"))


CELLS = st.integers(1, 40).flatmap(
    lambda n: arrays(np.float64, (n, 3), elements=st.integers(0, 5).map(float))
)


def brute_force(a: Floats, normals: Floats, b: Floats) -> dict[str, float]:
    """The rules of pc_error on few distinct points of a coarse grid."""
    ab = cdist(a, b, "sqeuclidean")
    nearest_ab = np.equal(ab, ab.min(axis=1)[:, None])
    nearest_ba = np.equal(ab.T, ab.min(axis=0)[:, None])
    takers = np.where(nearest_ab.any(axis=0)[:, None], nearest_ab.T, nearest_ba)
    normals_b = takers @ normals / takers.sum(axis=1)[:, None]
    return {
        "acd_ab_point": ab.min(axis=1).mean(),
        "acd_ba_point": ab.min(axis=0).mean(),
        "hausdorff_sq_point": max(ab.min(axis=1).max(), ab.min(axis=0).max()),
        "q99_point": max(_q99(ab.min(axis=1)), _q99(ab.min(axis=0))) ** 0.5,
        "acd_ab_plane": mean_projection(a, b, normals_b, nearest_ab),
        "acd_ba_plane": mean_projection(b, a, normals, nearest_ba),
    }


def _q99(values: Floats) -> float:
    return float(np.quantile(values, 0.99, method="inverted_cdf"))


def mean_projection(
    queries: Floats, points: Floats, normals: Floats, nearest: NDArray[np.bool_]
) -> float:
    along = np.einsum("ijk,jk->ij", queries[:, None] - points[None], normals)
    return np.mean((along**2 * nearest).sum(axis=1) / nearest.sum(axis=1))


@pytest.mark.parametrize("count", [99, 100, 101, 250])
def test_the_99_percent_quantile_of_the_worse_direction(count: int) -> None:
    """Points of a line, each raised by a distance of its own, with three far ones."""
    heights = np.append(np.linspace(0, 0.3, count - 3), [3.0, 4.0, 5.0])
    original = np.stack([10.0 * np.arange(count), np.zeros(count), np.zeros(count)], axis=1)
    decoded = original + heights[:, None] * [0, 0, 1]
    values = distortion(PointCloud(original, up(original)), decoded)
    expected = np.quantile(heights, 0.99, method="inverted_cdf")
    assert values["q99_point"] == pytest.approx(expected)
    assert values["q99_plane"] == pytest.approx(expected)
    assert distortion(PointCloud(original), decoded[:-4])["q99_point"] > 5  # of the missing points


@settings(max_examples=100)
@given(a=CELLS, b=CELLS, seed=st.integers(0, 2**31))
def test_distortion_is_that_of_brute_force_in_any_order(a: Floats, b: Floats, seed: int) -> None:
    random = generator(seed, "normals")
    a, b = np.unique(a, axis=0), np.unique(b, axis=0)
    normals = random.normal(size=a.shape)
    expected = brute_force(a, normals, b)
    rows = random.permutation(len(a))
    values = distortion(PointCloud(a[rows], normals[rows]), random.permutation(b))
    assert {key: values[key] for key in expected} == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_one_reference_gives_many_decoded_clouds_the_values_of_one_off_calls(name: str) -> None:
    cloud, decoded = load_pair(name)
    several = [decoded, decoded[::3], cloud.xyz + 0.25, np.tile(decoded, (2, 1)), decoded]
    for original in (cloud, PointCloud(cloud.xyz)):
        reference = ReferenceCloud(original)
        for each in several:
            assert distortion(reference, each) == distortion(original, each)


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_decoded_points_made_ready_once_have_the_values_of_one_off_calls(name: str) -> None:
    cloud, decoded = load_pair(name)
    ready = DistinctPoints(np.tile(decoded, (2, 1)))
    for original in (cloud, PointCloud(cloud.xyz + 0.25), PointCloud(decoded)):
        assert distortion(original, ready) == distortion(original, decoded)


def test_a_reference_knows_its_diameter_by_its_description_or_else_by_its_points() -> None:
    points = floor(11, 1.0)
    assert ReferenceCloud(PointCloud(points)).diameter == 200**0.5
    assert ReferenceCloud(PointCloud(points, about={"diameter": 100.0})).diameter == 100


@pytest.mark.parametrize("name", ["denser", "voxels", "random"])
def test_values_do_not_depend_on_the_order_of_the_points(name: str) -> None:
    reference, decoded = load_pair(name)
    random = generator(1, "order")
    shuffled = reference.select(random.permutation(len(reference)))
    assert distortion(shuffled, random.permutation(decoded)) == pytest.approx(
        distortion(reference, decoded), rel=1e-12
    )


@pytest.mark.parametrize(
    ("points", "normals", "decoded", "message"),
    [
        (np.zeros((0, 3)), None, np.zeros((1, 3)), "reference cloud: the cloud is empty"),
        (np.zeros((1, 3)), None, np.zeros((0, 3)), "decoded cloud: the cloud is empty"),
        (np.zeros((1, 3)), None, np.full((1, 3), np.nan), "1 of 1 points are not finite"),
        (np.zeros((1, 3)), np.full((1, 3), np.nan), np.zeros((1, 3)), "a normal is not finite"),
        (np.zeros((2, 3)), np.zeros((1, 3)), np.zeros((1, 3)), "expected normals of shape"),
    ],
)
def test_unusable_clouds_are_refused(
    points: Floats, normals: Floats | None, decoded: Floats, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        distortion(PointCloud(points, normals), decoded)

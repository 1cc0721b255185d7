"""Points for voxels: as many as there were, on the surface, whatever the voxels are."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from learned_codecs import RATES, changes, save_tiny

from puckbench.cloud import PointCloud
from puckbench.codecs.learned.filling import check_filling, filled, points_per_voxel
from puckbench.codecs.registry import open_codec
from puckbench.errors import InputError
from puckbench.metrics.geometry import distortion

FLAT = np.stack([*np.mgrid[0:8, 0:8].reshape(2, -1), np.full(64, 3)], axis=1)


def _tilted(side: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a slanted plane, in voxels of a side, and its unit normal."""
    normal = np.array([0.2, -0.35, 1.0])
    xy = np.random.default_rng(0).uniform(0, 60, (60_000, 2))
    points = np.column_stack([xy, 5 - xy @ normal[:2] / normal[2]]) / side
    return points, normal / np.linalg.norm(normal)


def test_one_point_for_each_voxel_is_the_voxel() -> None:
    assert np.array_equal(filled(FLAT, 8), FLAT)


def test_four_points_of_a_flat_surface_stand_half_a_voxel_apart() -> None:
    middle = FLAT[(FLAT[:, :2] > 0).all(axis=1) & (FLAT[:, :2] < 7).all(axis=1)]
    wanted = {
        (x + u, y + v, 3.0) for x, y, _ in middle for u in (-0.25, 0.25) for v in (-0.25, 0.25)
    }
    points = filled(FLAT, 32)
    assert len(points) == 4 * 64
    assert wanted <= {tuple(point) for point in points.tolist()}


@pytest.mark.parametrize("number", range(1, 10))
def test_points_of_a_voxel_are_spread_over_it(number: int) -> None:
    """No two share a place, none is nearer to a side than to the middle of its neighbour's."""
    points = filled(FLAT, 8 * number)
    inner = points[(np.abs(points[:, :2] - 3) < 0.5).all(axis=1)] - 3
    assert len(np.unique(inner, axis=0)) == number
    assert np.allclose(inner.mean(axis=0), 0, atol=0.1)
    assert np.abs(inner).max() <= 1 / 3 + 1e-12


def test_points_of_a_slanted_plane_are_nearer_to_it_than_its_voxels() -> None:
    points, normal = _tilted(1.5)
    voxels = np.unique(np.rint(points).astype(np.int64), axis=0)
    eighths = points_per_voxel(len(points), len(voxels), 1)
    found = filled(voxels, min(eighths, 32))
    height = points[0] @ normal
    off = [np.sqrt(np.mean((these @ normal - height) ** 2)) for these in (voxels, found)]
    assert off[1] < 0.85 * off[0]


def test_voxels_with_the_fewest_others_around_have_one_more() -> None:
    points = filled(FLAT, 9)
    assert len(points) == 64 + 8
    several = {tuple(voxel) for voxel in np.rint(points[:16]).astype(int).tolist()}
    corners = {(x, y, 3) for x in (0, 7) for y in (0, 7)}
    assert len(several) == 8
    assert corners < several


@given(
    arrays(np.int64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.integers(-40, 40)),
    st.integers(8, 72),
)
def test_any_voxels_have_as_many_points_as_asked_for(voxels: np.ndarray, eighths: int) -> None:
    voxels = np.unique(voxels, axis=0)
    points = filled(voxels, eighths)
    number, more = divmod(eighths, 8)
    assert len(points) == number * len(voxels) + len(voxels) * more // 8
    apart = np.abs(points[:, None] - voxels).max(axis=2).min(axis=1)
    assert apart.max() < 1.5  # half a voxel aside, as much for the slope, a share of being off


def test_voxels_too_far_apart_for_planes_stay_as_they_are() -> None:
    far = np.array([[0, 0, 0], [2**30, -(2**30), 5]])
    assert np.array_equal(filled(far, 40), far)


def test_the_number_of_points_is_told_in_eighths_and_bounded() -> None:
    assert points_per_voxel(150, 100, 1) == 12
    assert points_per_voxel(90, 100, 1) == 8
    assert points_per_voxel(5000, 100, 1) == 72
    assert points_per_voxel(2**22 + 1, 2**20, 1) == 8
    assert points_per_voxel(2**21, 2**20, 3) == 8
    check_filling(8, 2**40)
    check_filling(72, 2**18)
    for eighths, voxels in ((7, 1), (73, 1), (9, 2**23)):
        with pytest.raises(InputError, match="points of a voxel"):
            check_filling(eighths, voxels)


@pytest.mark.parametrize("name", ["pcgcv1", "pcgcv2"])
def test_a_cloud_decodes_into_as_many_points_nearer_to_it(name: str, tmp_path: Path) -> None:
    save_tiny(name, tmp_path / "tiny.pcgw")
    rates = {rate: {**values, "children": 2} for rate, values in RATES[name].items()}
    points = _tilted(1.0)[0][:30_000]
    decoded = []
    for fill in (True, False):
        codec = open_codec(name, {**changes(name, tmp_path, fill=fill), "rates": rates})
        stream = codec.encode(points, "r2")
        decoded.append(codec.decode(stream))
    assert len(decoded[1]) < len(points) / 3
    assert 0.87 * len(points) <= len(decoded[0]) <= len(points)
    cloud = PointCloud(points)
    full, thin = (distortion(cloud, found)["acd_ab_point"] for found in decoded)
    assert full < thin

"""Points for voxels: as many as there were, on the surface, whatever the voxels are."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial import cKDTree

from pcc_networks import pcgcv1, pcgcv2
from pcc_networks.point_reconstruction import (
    SiblingBlocks,
    check_points_per_voxel,
    joined_blocks,
    lossless_blocks,
    points_per_voxel,
    reconstructed_points,
    sibling_blocks,
)
from pointkit.errors import InputError
from tests.support.learned_codecs import save_tiny

FLAT = np.stack([*np.mgrid[0:8, 0:8].reshape(2, -1), np.full(64, 3)], axis=1)


def _tilted(side: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a slanted plane, in voxels of a side, and its unit normal."""
    normal = np.array([0.2, -0.35, 1.0])
    xy = np.random.default_rng(0).uniform(0, 60, (60_000, 2))
    points = np.column_stack([xy, 5 - xy @ normal[:2] / normal[2]]) / side
    return points, normal / np.linalg.norm(normal)


def _unconfident(voxels: np.ndarray) -> SiblingBlocks:
    """One voxel is kept of each block, any of these would have been as likely, others hardly."""
    blocks = lossless_blocks(voxels)
    first = np.zeros_like(blocks.kept)
    first[np.arange(len(first)), blocks.kept.argmax(axis=1)] = True
    return sibling_blocks(
        blocks.positions, np.where(blocks.kept, -1, -60).astype(np.float32), first
    )


def _mean_square(points: np.ndarray, others: np.ndarray) -> float:
    """Mean squared distance of points to the nearest of others."""
    return float(np.mean(cKDTree(others).query(points)[0] ** 2))


def _sorted(rows: np.ndarray) -> np.ndarray:
    return rows[np.lexsort(rows.T)]


def test_one_point_for_each_voxel_is_the_voxel() -> None:
    assert np.array_equal(_sorted(reconstructed_points(lossless_blocks(FLAT), 256)), _sorted(FLAT))
    unconfident = _unconfident(FLAT)
    assert np.array_equal(reconstructed_points(unconfident, 0), unconfident.voxels())


def test_four_points_of_a_flat_surface_stand_half_a_voxel_apart() -> None:
    middle = FLAT[(FLAT[:, :2] > 0).all(axis=1) & (FLAT[:, :2] < 7).all(axis=1)]
    expected_points = {
        (x + u, y + v, 3.0) for x, y, _ in middle for u in (-0.25, 0.25) for v in (-0.25, 0.25)
    }
    points = reconstructed_points(lossless_blocks(FLAT), 4 * 256)
    assert len(points) == 4 * 64
    assert expected_points <= {tuple(point) for point in points.tolist()}


@pytest.mark.parametrize("number", range(1, 10))
def test_points_of_a_voxel_are_spread_over_it(number: int) -> None:
    """No two share a place, none is nearer to a side than to the middle of its neighbour's."""
    points = reconstructed_points(lossless_blocks(FLAT), 256 * number)
    inner = points[(np.abs(points[:, :2] - 3) < 0.5).all(axis=1)] - 3
    assert len(np.unique(inner, axis=0)) == number
    assert np.allclose(inner.mean(axis=0), 0, atol=0.1)
    assert np.abs(inner).max() <= 1 / 3 + 1e-12


def test_points_of_a_slanted_plane_are_nearer_to_it_than_its_voxels() -> None:
    points, normal = _tilted(1.5)
    voxels = np.unique(np.rint(points).astype(np.int64), axis=0)
    parts = points_per_voxel(len(points), len(voxels), 1)
    result = reconstructed_points(lossless_blocks(voxels), min(parts, 4 * 256))
    height = points[0] @ normal
    off = [np.sqrt(np.mean((these @ normal - height) ** 2)) for these in (voxels, result)]
    assert off[1] < 0.85 * off[0]


def test_voxels_with_the_fewest_others_around_have_one_more() -> None:
    points = reconstructed_points(lossless_blocks(FLAT), 256 + 32)
    assert len(points) == 64 + 8
    several = {tuple(voxel) for voxel in np.rint(points[-16:]).astype(int).tolist()}
    corners = {(x, y, 3) for x in (0, 7) for y in (0, 7)}
    assert len(several) == 8
    assert corners < several


@given(
    arrays(np.int64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.integers(-40, 40)),
    st.integers(256, 2304),
)
def test_any_voxels_have_as_many_points_as_asked_for(voxels: np.ndarray, parts: int) -> None:
    voxels = np.unique(voxels, axis=0)
    points = reconstructed_points(lossless_blocks(voxels), parts)
    assert len(points) == np.rint(len(voxels) * parts / 256)
    apart = np.abs(points[:, None] - voxels).max(axis=2).min(axis=1)
    assert apart.max() < 1.5  # half a voxel aside, as much for the slope, a share of being off


@given(
    arrays(np.int64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.integers(-40, 40)),
    st.integers(256, 2304),
    st.integers(0, 2**32 - 1),
)
def test_unconfident_voxels_have_about_as_many(voxels: np.ndarray, parts: int, seed: int) -> None:
    blocks = lossless_blocks(np.unique(voxels, axis=0))
    logits = np.random.default_rng(seed).normal(-1, 3, blocks.kept.shape).astype(np.float32)
    points = reconstructed_points(sibling_blocks(blocks.positions, logits, blocks.kept), parts)
    expected_points = blocks.kept.sum() * parts / 256
    assert expected_points - 1 <= len(points) <= expected_points + len(blocks.positions)
    apart = np.abs(points[:, None] - (2 * blocks.positions + 0.5)).max(axis=2).min(axis=1)
    assert apart.max() < 3  # a voxel aside, as much for the slope, the expected place, being off


def test_voxels_too_far_apart_for_planes_stay_as_they_are() -> None:
    far = np.array([[0, 0, 0], [2**30, -(2**30), 5]])
    assert np.array_equal(
        _sorted(reconstructed_points(lossless_blocks(far), 5 * 256)), _sorted(far)
    )


def test_points_are_placed_at_the_centroid_of_an_unconfident_network() -> None:
    """It keeps any one voxel of a block, but says that all four of a layer are as likely."""
    blocks = _unconfident(FLAT)
    assert np.array_equal(np.unique(blocks.kept.sum(axis=1)), [1])
    points = reconstructed_points(blocks, 256)
    inner = points[(np.abs(points[:, :2] - 3.5) < 2.5).all(axis=1)]
    middles = 2.0 * np.stack([*np.mgrid[1:3, 1:3].reshape(2, -1)], axis=1) + 0.5
    assert np.allclose(_sorted(inner)[:, :2], _sorted(middles), atol=1e-9)
    assert np.all(np.abs(points[:, 2] - 2.9) < 1e-9)  # 0.8 of the way from 2.5 to 3


def test_a_sparse_cloud_is_nearer_to_points_of_its_blocks_than_to_any_voxels() -> None:
    points, _ = _tilted(1.0)
    rng = np.random.default_rng(1)
    thin = points[rng.choice(len(points), 1200, replace=False)]
    all_voxels = lossless_blocks(np.unique(np.rint(points).astype(np.int64), axis=0))
    blocks = lossless_blocks(np.unique(np.rint(thin).astype(np.int64), axis=0))
    original = {tuple(place): row for row, place in enumerate(all_voxels.positions.tolist())}
    could = all_voxels.kept[[original[tuple(place)] for place in blocks.positions.tolist()]]
    logits = np.where(could, -1.0, -6.0).astype(np.float32)
    likeliest = np.zeros_like(blocks.kept)
    likeliest[np.arange(len(logits)), logits.argmax(axis=1)] = True
    unconfident = sibling_blocks(blocks.positions, logits, likeliest)
    results = [reconstructed_points(unconfident, parts) for parts in (256, 0)]
    expected, kept = (max(_mean_square(thin, r), _mean_square(r, thin)) for r in results)
    assert expected < 0.75 * kept


def test_blocks_with_more_expected_voxels_have_more_points() -> None:
    places = np.stack([*np.mgrid[0:10, 0:10].reshape(2, -1), np.zeros(100, int)], axis=1)
    many = places[:, 0] % 2 == 0
    logits = np.where(many[:, None], 0.5, -0.8) * np.ones((1, 8))
    kept = np.zeros((100, 8), dtype=bool)
    kept[:, :4] = True
    points = reconstructed_points(sibling_blocks(places, logits.astype(np.float32), kept), 256)
    at = np.rint((points[:, 0] - 0.5) / 2).astype(int)
    counts = np.bincount(at, minlength=10).reshape(5, 2).sum(axis=0)
    assert counts.sum() == 400
    assert counts[0] / counts[1] == pytest.approx(0.6225 / 0.31, rel=0.1)


def test_any_logits_give_finite_points() -> None:
    blocks = lossless_blocks(FLAT)
    for wild in (np.nan, np.inf, -np.inf, 1e30, -1e30):
        logits = np.full(blocks.kept.shape, wild, dtype=np.float32)
        points = reconstructed_points(sibling_blocks(blocks.positions, logits, blocks.kept), 300)
        assert np.isfinite(points).all()
        assert np.abs(points).max() < 12


def test_blocks_that_keep_nothing_are_left_out() -> None:
    kept = np.zeros((3, 8), dtype=bool)
    kept[1, 5] = True
    places = np.arange(9).reshape(3, 3)
    result = sibling_blocks(places, np.zeros((3, 8), dtype=np.float32), kept)
    assert result.voxels().tolist() == [[7, 8, 11]]  # 2 * (3, 4, 5) and x, z of the fifth corner
    both = joined_blocks([result, lossless_blocks(np.array([[0, 1, 0]]))])
    assert both.voxels().tolist() == [[7, 8, 11], [0, 1, 0]]


def test_points_per_voxel_are_bounded_256ths() -> None:
    assert points_per_voxel(150, 100, 1) == 384
    assert points_per_voxel(90, 100, 1) == 256
    assert points_per_voxel(5000, 100, 1) == 9 * 256
    assert points_per_voxel(2**22 + 1, 2**20, 1) == 256
    assert points_per_voxel(2**21, 2**20, 3) == 256
    check_points_per_voxel(0, 2**40)
    check_points_per_voxel(256, 2**40)
    check_points_per_voxel(9 * 256, 2**18)
    for parts, voxels in ((255, 1), (9 * 256 + 1, 1), (257, 2**23)):
        with pytest.raises(InputError, match="points of a voxel"):
            check_points_per_voxel(parts, voxels)


@pytest.mark.parametrize("library", [pcgcv1, pcgcv2], ids=["pcgcv1", "pcgcv2"])
def test_a_cloud_decodes_into_as_many_points_nearer_to_it(
    library: ModuleType, tmp_path: Path
) -> None:
    save_tiny(library.__name__.rpartition(".")[2], tmp_path / "tiny.safetensors")
    weights = library.load_weights(tmp_path / "tiny.safetensors")
    points = _tilted(1.0)[0][:30_000]
    full, thin = (
        library.decode(
            library.encode(
                points, weights, 1, mean_occupied_children=2, point_reconstruction=reconstructed
            ),
            weights,
        )
        for reconstructed in (True, False)
    )
    assert len(thin) < len(points) / 3
    assert 0.87 * len(points) <= len(full) <= len(points)
    assert _mean_square(points, full) < _mean_square(points, thin)

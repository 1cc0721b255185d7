"""Parts of the primitives codec: axes of a room, voxels that move, the judge, rate of voxels."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from puckbench.primitives import voxel_mode
from puckbench.primitives.displacements import displace, fit_displacements
from puckbench.primitives.distortion import DistortionEstimator
from puckbench.primitives.manhattan_frame import (
    ROTATION_STEP,
    estimate_manhattan_frame,
    rotate,
    rotate_inverse,
    rotation_matrix,
)
from puckbench.primitives.stream import (
    CLASSES,
    DisplacementTable,
    VoxelGrid,
    VoxelHeader,
    unpack,
)


def _box_normals(count: int = 3000) -> np.ndarray:
    rng = np.random.default_rng(0)
    normals = np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1, 1], count)[:, None]
    normals += rng.normal(0, 0.02, normals.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("turn", [(0, 0, 0), (300, -4000, 17), (32767, 0, 0)])
def test_rotations_are_those_of_rotation_vectors(turn: tuple[int, int, int]) -> None:
    expected = Rotation.from_rotvec(np.array(turn) * ROTATION_STEP).as_matrix()
    matrix = rotation_matrix(turn)
    assert np.allclose(matrix, expected)
    assert np.allclose(rotate(_box_normals(), matrix), _box_normals() @ expected.T)
    assert np.allclose(rotate_inverse(_box_normals(), matrix), _box_normals() @ expected)


@pytest.mark.parametrize("degrees", [(0, 0, 30), (10, 5, 40), (3, -2, 1)])
def test_the_manhattan_frame_of_a_rotated_box_undoes_its_rotation(
    degrees: tuple[float, float, float],
) -> None:
    turned = Rotation.from_rotvec(degrees, degrees=True).as_matrix()
    back = rotation_matrix(estimate_manhattan_frame(_box_normals() @ turned.T)) @ turned
    assert np.allclose(np.sort(np.abs(back), axis=1), [0, 0, 1], atol=0.01)


def test_the_frame_of_a_single_wall_has_an_axis_along_its_normal() -> None:
    normal = np.array([0.21, -0.13, 1.0]) / np.sqrt(0.21**2 + 0.13**2 + 1)
    normals = normal + np.random.default_rng(0).normal(0, 0.02, (2000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turned = rotation_matrix(estimate_manhattan_frame(normals)) @ normal
    assert np.sort(np.abs(turned))[2] == pytest.approx(1, abs=1e-3)


def test_no_manhattan_frame_is_estimated_for_aligned_boxes_and_spheres() -> None:
    rng = np.random.default_rng(1)
    round_ones = rng.normal(size=(4000, 3))
    round_ones /= np.linalg.norm(round_ones, axis=1, keepdims=True)
    assert estimate_manhattan_frame(_box_normals()) == (0, 0, 0)
    assert estimate_manhattan_frame(round_ones) == (0, 0, 0)


UNIT_GRID = VoxelGrid(np.zeros(3), 1.0)


def _askew_plane(noise: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(2)
    u, v = rng.random((2, 20_000)) * 60
    return np.column_stack([u, v, 0.3 * u + 0.2 * v + rng.normal(0, noise, len(u))])


def _off(points: np.ndarray) -> float:
    """Mean squared distance to the askew plane."""
    normal = np.array([-0.3, -0.2, 1.0]) / np.sqrt(1.13)
    return float(np.mean((points @ normal) ** 2))


def test_displaced_voxels_of_a_plane_are_nearer_to_it() -> None:
    found = voxel_mode.voxelise(_askew_plane(), UNIT_GRID)
    table, gain, _ = fit_displacements(found.cells, found.means, np.ones(len(found.cells)))
    assert gain > 0
    assert _off(displace(found.cells, table)) < 0.3 * _off(found.cells)


def test_voxels_within_the_noise_are_hardly_displaced() -> None:
    found = voxel_mode.voxelise(_askew_plane(noise=6.0), UNIT_GRID)
    table, *_ = fit_displacements(found.cells, found.means, np.ones(len(found.cells)))
    shift = np.linalg.norm(displace(found.cells, table) - found.cells, axis=1)
    assert np.quantile(shift, 0.95) < 0.5


def test_the_gain_of_a_displacement_table_is_the_error_that_it_saves() -> None:
    found = voxel_mode.voxelise(_askew_plane(noise=0.5), UNIT_GRID)
    weights = found.counts
    table, gain, _ = fit_displacements(found.cells, found.means, weights)
    before = (weights[:, None] * (found.cells - found.means) ** 2).sum()
    after = (weights[:, None] * (displace(found.cells, table) - found.means) ** 2).sum()
    assert before - after == pytest.approx(gain, rel=1e-9)


def test_few_voxels_are_not_displaced() -> None:
    few = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0]])
    assert np.array_equal(displace(few, DisplacementTable(1, np.full(CLASSES, 64, np.int8))), few)


@pytest.mark.parametrize("most", [300, 3000])
def test_voxels_use_nearly_all_of_the_byte_budget(most: int) -> None:
    stream = voxel_mode.VoxelSearch(_askew_plane(noise=0.5)).encode_to_budget(most).stream
    assert 0.8 * most < len(stream) <= most


def test_voxels_do_not_exceed_the_largest_side_even_above_the_budget() -> None:
    points = _askew_plane()
    header, _ = unpack(
        voxel_mode.VoxelSearch(points).encode_to_budget(10, max_voxel_size=8.0).stream
    )
    assert isinstance(header, VoxelHeader)
    assert header.grid.cell_size <= 8.0 * np.ptp(points, axis=0).max() / 1023 * (1 + 1e-6)


def test_voxels_without_displacements_are_the_cells_of_points() -> None:
    points = _askew_plane()
    header, bits = unpack(voxel_mode.encode_voxels_of_size(points, 2.0))
    assert isinstance(header, VoxelHeader)
    plain = voxel_mode.decode(header._replace(displacements=None), bits)
    farthest = np.abs(points[:, None, :2] - plain[None, :400, :2]).min(axis=0).max()
    assert len(plain) == len(voxel_mode.voxelise(points, header.grid).cells)
    assert farthest <= 1 + 1e-9


def test_grid_placements_in_single_precision_are_stable() -> None:
    place = VoxelGrid(np.array([4000.1, -250.3, 30.7]), 0.0123).rounded()
    assert np.array_equal(place.origin, place.rounded().origin)
    assert place.cell_size == place.rounded().cell_size


def test_the_distortion_estimate_tells_noise_from_error() -> None:
    u, v = np.meshgrid(np.arange(0, 60, 0.5), np.arange(0, 60, 0.5))
    true = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)])
    noise = np.random.default_rng(3).normal(0, 0.2, len(true))
    noisy = true + noise[:, None] * [0.0, 0.0, 1.0]
    samples = true[::7]
    up = np.tile([0.0, 0.0, 1.0], (len(samples), 1))
    estimator = DistortionEstimator.of(noisy, samples, up, np.full(len(samples), 1 / len(samples)))
    same, smooth = estimator.measure(noisy), estimator.measure(true)
    assert same.plane == same.point == 0
    assert smooth.plane == pytest.approx(0.04, rel=0.1)
    assert smooth.surface == 0
    assert same.surface == pytest.approx(0.04, rel=0.15)


def test_the_distortion_estimate_weighs_samples_by_their_points() -> None:
    u, v = np.meshgrid(np.arange(0, 60, 2.0), np.arange(0, 60, 2.0))
    samples = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)])
    dense = samples[:, 0] < 30
    shares = np.where(dense, 0.9, 0.1) / dense.sum()
    up = np.tile([0.0, 0.0, 1.0], (len(samples), 1))
    estimator = DistortionEstimator.of(samples, samples, up, shares)
    lifted = samples + np.where(dense, 0.0, 1.0)[:, None] * [0.0, 0.0, 1.0]
    assert estimator.surface_error(lifted) == pytest.approx((0.1 + 0.5) / 2, abs=0.01)

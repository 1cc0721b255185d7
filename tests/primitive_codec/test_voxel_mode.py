"""The voxel mode: displacement of voxels, and byte budgets."""

import numpy as np
import pytest

from primitive_codec import voxel_mode
from primitive_codec.stream import CLASSES, DisplacementTable, VoxelGrid, VoxelHeader, unpack
from primitive_codec.voxel_mode import displace, fit_displacements

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
    groups = voxel_mode.voxelise(_askew_plane(), UNIT_GRID)
    table, gain, _ = fit_displacements(groups.cells, groups.means, np.ones(len(groups.cells)))
    assert gain > 0
    assert _off(displace(groups.cells, table)) < 0.3 * _off(groups.cells)


def test_voxels_within_the_noise_are_hardly_displaced() -> None:
    groups = voxel_mode.voxelise(_askew_plane(noise=6.0), UNIT_GRID)
    table, *_ = fit_displacements(groups.cells, groups.means, np.ones(len(groups.cells)))
    shift = np.linalg.norm(displace(groups.cells, table) - groups.cells, axis=1)
    assert np.quantile(shift, 0.95) < 0.5


def test_the_gain_of_a_displacement_table_is_the_error_that_it_saves() -> None:
    groups = voxel_mode.voxelise(_askew_plane(noise=0.5), UNIT_GRID)
    weights = groups.counts
    table, gain, _ = fit_displacements(groups.cells, groups.means, weights)
    before = (weights[:, None] * (groups.cells - groups.means) ** 2).sum()
    after = (weights[:, None] * (displace(groups.cells, table) - groups.means) ** 2).sum()
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
    points_of_voxels = voxel_mode.decode(header._replace(displacements=None), bits)
    farthest = np.abs(points[:, None, :2] - points_of_voxels[None, :400, :2]).min(axis=0).max()
    assert len(points_of_voxels) == len(voxel_mode.voxelise(points, header.grid).cells)
    assert farthest <= 1 + 1e-9


def test_grid_placements_in_single_precision_are_stable() -> None:
    grid = VoxelGrid(np.array([4000.1, -250.3, 30.7]), 0.0123).rounded()
    assert np.array_equal(grid.origin, grid.rounded().origin)
    assert grid.cell_size == grid.rounded().cell_size

"""Grid levels: coarsening of sparse clouds, on planes of known density."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pcc_networks import pcgcv1, pcgcv2
from pcc_networks.grid_level import (
    octaves_of_points,
    octaves_to_density,
    on_dense_grids,
    voxel_size,
    voxelised,
)
from pcc_networks.sparse.voxels import morton_keys, unique_keys
from pointkit.errors import InputError
from tests.support.learned_codecs import save_tiny

pytestmark = pytest.mark.usefixtures("one_thread")


def _plane(step: int = 1, side: int = 128) -> np.ndarray:
    """Points every `step` voxels in a plane."""
    axis = np.arange(0.0, side, step)
    x, y = np.meshgrid(axis, axis)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


@pytest.mark.parametrize(("step", "octaves"), [(1, 0), (2, 1), (4, 2), (8, 3)])
def test_a_grid_is_coarsened_until_a_surface_is_dense_on_it(step: int, octaves: int) -> None:
    assert octaves_of_points(_plane(step) - 1000, 4) == octaves
    assert octaves_of_points(_plane(step), 1) == 0


def test_every_second_voxel_at_random_leaves_half_the_children() -> None:
    plane = _plane()
    kept = plane[np.random.default_rng(0).random(len(plane)) < 0.5]  # 2.13 of each four in the mean
    fine = len(kept) / len(np.unique(kept // 2, axis=0))
    coarse = len(np.unique(kept // 2, axis=0)) / len(np.unique(kept // 4, axis=0))
    assert (fine, coarse) == pytest.approx((2.13, 3.77), abs=0.05)
    assert octaves_of_points(kept, 1.8) == 0
    assert octaves_of_points(kept, (fine + coarse) / 2) == pytest.approx(0.5)
    assert octaves_of_points(kept, coarse) == 1


@pytest.mark.parametrize(
    "points",
    [np.zeros((1, 3)), np.arange(300.0).reshape(-1, 1) * [8, 0, 0], _plane(64)],
    ids=["one point", "a thin line", "few points"],
)
def test_clouds_that_are_never_dense_keep_their_grid(points: np.ndarray) -> None:
    assert octaves_of_points(points, 3) == 0


def test_clouds_too_wide_for_keys_keep_their_grid() -> None:
    assert octaves_of_points(np.vstack([_plane(2), [[2.0**21, 0, 0]]]), 3) == 0


def test_keys_and_points_agree() -> None:
    keys = unique_keys(morton_keys(_plane(4).astype(np.int64)))
    assert octaves_to_density(keys, 4) == octaves_of_points(_plane(4), 4) == 2


def test_training_uses_each_dense_grid_once() -> None:
    kept = _plane()[np.random.default_rng(0).random(128**2) < 0.5]
    grids = on_dense_grids(kept, (1.8, 2.4, 3.7))
    assert [len(grid) for grid in grids] == [len(kept), len(np.unique(np.rint(kept / 2), axis=0))]


@pytest.mark.parametrize("library", [pcgcv1, pcgcv2], ids=["pcgcv1", "pcgcv2"])
@pytest.mark.parametrize(
    ("offset", "side"), [(0.5, 2**0.5), (-1, 1), (1.26, 2**1.25), (99, 2**20), (2000, 2**20)]
)
def test_grid_levels_are_quarter_octaves(
    library: ModuleType, offset: float, side: float, tmp_path: Path
) -> None:
    save_tiny(library.__name__.rpartition(".")[2], tmp_path / "tiny.safetensors")
    weights = library.load_weights(tmp_path / "tiny.safetensors")
    grid = {"mean_occupied_children": 2, "grid_level_offset": offset}
    stream = library.encode(_plane() + 1000, weights, 1, **grid, point_reconstruction=False)
    decoded = library.decode(stream, weights)
    voxels = decoded / side
    assert np.abs(voxels - np.rint(voxels)).max() < 1e-9
    assert len(decoded) == len(np.unique(np.rint((_plane() + 1000) / side), axis=0))
    assert np.abs(decoded - [1063, 1063, 1000]).max() < 64 + 64 * side


def test_a_stream_says_whether_each_parent_keeps_a_child(tmp_path: Path) -> None:
    save_tiny("pcgcv2", tmp_path / "tiny.safetensors")
    weights = pcgcv2.load_weights(tmp_path / "tiny.safetensors")
    with_children, without = (
        pcgcv2.decode(pcgcv2.encode(_plane(4), weights, 1, tools=tools), weights)
        for tools in (pcgcv2.CodingTools.CHILD_PER_PARENT, pcgcv2.CodingTools(0))
    )
    coarse = [len(np.unique(result // 4, axis=0)) for result in (with_children, without)]
    assert coarse[0] > coarse[1]


def test_a_side_doubles_in_four_steps() -> None:
    assert [voxel_size(quarter_octaves) for quarter_octaves in (0, 4, 8, 80)] == [1, 2, 4, 2**20]
    assert voxel_size(3) ** 4 == pytest.approx(8)
    points = np.random.default_rng(0).uniform(-1000, 1000, (200, 3))
    for quarter_octaves in range(9):
        back = voxelised(points, quarter_octaves) * voxel_size(quarter_octaves)
        assert np.abs(back - points).max() <= 2 ** (quarter_octaves / 4) / 2 + 1e-9


def test_impossible_grid_levels_are_refused() -> None:
    from pcc_networks.pcgcv2.stream import CodedBlock, Pcgcv2Stream, read_stream, write_coded

    coded = Pcgcv2Stream(
        b"12345678", 1, (0, 0, 0), (CodedBlock((30, 8, 2, 1), b"", b""),), quarter_octaves=81
    )
    with pytest.raises(InputError, match="header"):
        read_stream(write_coded(coded))

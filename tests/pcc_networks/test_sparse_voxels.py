import numpy as np
import pytest

from pcc_networks.sparse.voxels import (
    VoxelSet,
    children_voxels,
    morton_keys,
    morton_voxels,
    pyramid,
    selected_children,
    unique_keys,
)

OFFSETS = [(d % 3 - 1, d // 3 % 3 - 1, d // 9 - 1) for d in range(27)]


def _scattered(side: int, count: int, seed: int = 0) -> np.ndarray:
    return np.unique(np.random.default_rng(seed).integers(0, side, (count, 3)), axis=0)


def _table_by_search(voxels: np.ndarray) -> np.ndarray:
    rows = {tuple(voxel): row for row, voxel in enumerate(voxels.tolist())}
    return np.array(
        [
            [rows.get((x + a, y + b, z + c), -1) for x, y, z in voxels.tolist()]
            for a, b, c in OFFSETS
        ]
    )


@pytest.mark.parametrize("side", [2, 100, 2**20])
def test_voxels_come_back_from_their_keys(side: int) -> None:
    voxels = _scattered(side, 500)
    assert np.array_equal(morton_voxels(morton_keys(voxels)), voxels)
    assert morton_keys(voxels).min() >= 0


def test_x_is_the_lowest_bit_of_a_key() -> None:
    corners = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0]])
    assert morton_keys(corners).tolist() == [1, 2, 4, 8]


def test_neighbours_are_those_that_a_search_finds_at_every_scale() -> None:
    sets, _ = pyramid(np.sort(morton_keys(_scattered(12, 400))), scales=3)
    for voxels in sets:
        assert np.array_equal(voxels.neighbours, _table_by_search(morton_voxels(voxels.keys)))


def test_unique_keys_are_in_order_and_each_once() -> None:
    assert unique_keys(np.array([5, 0, 7, 5, 0])).tolist() == [0, 5, 7]


def test_coarser_sets_are_the_voxels_halved() -> None:
    fine = _scattered(40, 300)
    sets, child_maps = pyramid(np.sort(morton_keys(fine)), scales=2)
    for scale in (1, 2):
        halved = np.unique(fine >> scale, axis=0)
        assert np.array_equal(np.sort(morton_keys(halved)), sets[scale].keys)
    parents = child_maps[0].slots >> 3
    assert np.array_equal(sets[1].keys[parents], sets[0].keys >> 3)
    assert np.array_equal(
        np.searchsorted(parents, np.arange(len(sets[1]))), child_maps[0].first[:-1]
    )


def test_parents_left_without_children_are_gone_from_the_neighbourhood() -> None:
    sets, child_maps = pyramid(np.sort(morton_keys(_scattered(12, 300))), scales=1)
    slots = child_maps[0].slots[child_maps[0].slots >> 3 != 4]
    some = selected_children(sets[1], slots)
    assert len(some) < len(sets[0])
    assert np.array_equal(some.neighbours, _table_by_search(morton_voxels(some.keys)))


def test_one_voxel_has_itself_alone() -> None:
    sets, _ = pyramid(np.array([5]), scales=3)
    for voxels in sets:
        assert isinstance(voxels, VoxelSet)
        assert voxels.neighbours[:, 0].tolist() == [-1] * 13 + [0] + [-1] * 13
    assert children_voxels(sets[1], np.array([5])).keys.tolist() == [5]

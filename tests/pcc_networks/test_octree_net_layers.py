"""The octree network's compiled layers, and the cells around a voxel's children."""

import numba
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pcc_networks.octree_net.causal_neighbourhood import CELLS, empty_state, find_neighbourhood
from pcc_networks.octree_net.codec import decode_part, encode_part
from pcc_networks.octree_net.inference import CHUNK_ROWS, compiled_network
from pcc_networks.octree_net.model import UNITS, OctreeNetShape
from pcc_networks.octree_net.symbols import groups_of, slots_of, symbols_of
from pcc_networks.sparse.convolution import neighbourhood_of
from pcc_networks.sparse.gather_scatter import voxel_kernel_map
from pcc_networks.sparse.thread_pool import slices, thread_pool
from pcc_networks.sparse.voxels import morton_keys, morton_voxels, pyramid
from pointkit.coding.intrinsics import add_products
from tests.support.learned_codecs import frequencies, octree_network, torch_threads

Floats, Ints = NDArray[np.float32], NDArray[np.int64]


@numba.njit
def _products(
    sums: Floats, targets: Ints, read: Floats, sources: Ints, pairs: int, kernel: Floats
) -> None:
    add_products(sums, targets, read, sources, pairs, kernel, 15, 5, 3)


@pytest.mark.parametrize("pairs", [0, 1, 3, 4, 9])
def test_products_are_those_of_matrices(pairs: int) -> None:
    rng = np.random.default_rng(pairs)
    sums, read = rng.integers(-99, 99, (12, 3)), rng.integers(0, 256, (20, 5))
    kernel = rng.integers(-2047, 2048, (2, 5, 3))
    targets, sources = rng.permutation(12)[:9], rng.integers(0, 20, 9)
    result, values, matrices = (array.astype(np.float32).ravel() for array in (sums, read, kernel))
    _products(result, targets, values, sources, pairs, matrices)
    sums[targets[:pairs]] += read[sources[:pairs]] @ kernel[1]
    assert np.array_equal(result.reshape(12, 3), sums)


def _cloud(points: int, side: int) -> np.ndarray:
    """A noisy floor and scattered voxels."""
    rng = np.random.default_rng(0)
    voxels = rng.integers(0, side, (points, 3))
    voxels[::2, 2] = rng.normal(side / 2, 1.5, len(voxels[::2])).astype(int)
    return np.unique(morton_keys(voxels))


def test_inference_predicts_what_the_models_own_layers_predict() -> None:
    """On a level of several chunks, for every group and both symbols."""
    keys = _cloud(150_000, 128)
    own = np.unique(keys >> 3)
    model, table = octree_network(OctreeNetShape(channels=32)), pyramid(own, 0)[0][0].neighbours
    network, (first, second) = compiled_network(model), symbols_of(keys)
    rng = np.random.default_rng(1)
    values = rng.integers(-300, 300, (len(own), 32)).astype(np.float32)
    features = network.root_features(len(own))
    features.all[:], features.active[:] = values.ravel(), values.clip(0, 255).ravel()
    assert len(slices(len(groups_of(own)[0]), CHUNK_ROWS)) > 1
    with thread_pool(2) as pool, torch.no_grad():
        where = neighbourhood_of(table, voxel_kernel_map(), pool)
        mine = model.convolved(torch.from_numpy(values / UNITS), where)
        ours = network.convolved(features, table, pool)
        for number, rows in enumerate(groups_of(own)):
            at = torch.from_numpy(rows)
            expected = model.group_features(number, mine, at, where)
            group = network.group(number, rows, ours, table)
            chunks = slices(len(rows), CHUNK_ROWS)
            predicted = np.concatenate([group.predict_first(chunk) for chunk in chunks])
            assert np.array_equal(
                predicted, frequencies(model.first_heads[number](expected).numpy())
            )
            expected = model.with_first(expected, torch.from_numpy(first[rows].astype(int)))
            predicted = np.concatenate([group.predict_second(c, first[rows[c]]) for c in chunks])
            assert np.array_equal(
                predicted, frequencies(model.second_heads[number](expected).numpy())
            )
            mine[at] = model.with_second(expected, torch.from_numpy(second[rows].astype(int)))
            for chunk in chunks:
                group.update(chunk, second[rows[chunk]])
        slots = slots_of(first, second)
        handed = network.child_features(ours, slots, pool)
    whole = (model.child_features(mine, torch.from_numpy(slots)) * UNITS).detach().numpy()
    assert np.array_equal(handed.all.reshape(-1, 32), whole)
    assert np.array_equal(handed.active.reshape(-1, 32), whole.clip(0, 255))


def test_threads_change_nothing_where_levels_have_many_chunks() -> None:
    keys, model = _cloud(150_000, 128), octree_network()
    parts = []
    for threads in (1, 2, 3):
        with torch_threads(threads):
            parts.append(encode_part(keys, model))
            assert np.array_equal(decode_part(parts[0], model), keys)
    assert parts[0] == parts[1] == parts[2]


def test_cells_around_a_voxel_are_its_neighbours_children() -> None:
    keys = _cloud(3000, 32)
    own = np.unique(keys >> 3)
    level, (first, second) = empty_state(pyramid(own, 0)[0][0].neighbours), symbols_of(keys)
    slots = slots_of(first, second)
    codes = np.bincount(slots >> 3, 1 << (slots & 7)).astype(np.uint8)
    done = np.random.default_rng(2).random(len(own)) < 0.5
    level.codes[done], level.done[:] = codes[done], done
    rows = np.flatnonzero(~done)
    find_neighbourhood(level, rows)
    occupied = {tuple(voxel) for voxel in morton_voxels(keys[done[slots >> 3]]).tolist()}
    unknown = {tuple(voxel) for voxel in morton_voxels(own[~done]).tolist()}
    for row in rows[:200]:
        corner = 2 * morton_voxels(own[row : row + 1])[0] - 1
        for cell in range(64):
            x, y, z = (corner + np.array([cell & 3, cell >> 2 & 3, cell >> 4])).tolist()
            parent = (x // 2, y // 2, z // 2)
            inside = parent == tuple(((corner + 1) // 2).tolist())
            assert (level.occupied[row] >> cell & 1) == ((x, y, z) in occupied)
            assert (level.unknown[row] >> cell & 1) == (parent in unknown and not inside)


def test_cells_of_a_child_have_their_distances() -> None:
    def place(cell: int) -> np.ndarray:
        return np.array([cell & 3, cell >> 2 & 3, cell >> 4])

    def apart(child: int, cells: np.ndarray) -> list[list[int]]:
        own = place(int(CELLS.inner[child]))
        return sorted(sorted(np.abs(place(int(cell)) - own).tolist()) for cell in cells)

    for child in range(8):
        assert apart(child, CELLS.beyond[child]) == [[0, 0, 1]] * 3
        assert apart(child, CELLS.second[child]) == [[0, 0, 2]] * 3
        assert apart(child, CELLS.edges[child]) == [[0, 1, 1]] * 3
        assert apart(child, CELLS.across[child]) == [[0, 1, 1]] * 6
        outside = np.concatenate([CELLS.beyond[child], CELLS.edges[child], CELLS.across[child]])
        assert not set(outside.tolist()) & set(CELLS.inner.tolist())
        sets = [int(kind[child]) for kind in (CELLS.faces, CELLS.ring, CELLS.corners, CELLS.far)]
        assert [(cells % 2**64).bit_count() for cells in sets] == [6, 12, 8, 37]

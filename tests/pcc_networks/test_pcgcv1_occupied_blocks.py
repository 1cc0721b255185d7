"""PCGCv1 when the stream holds the occupied blocks: tiny networks of random weights."""

import numpy as np
import pytest
import torch
from torch.nn.functional import max_pool3d

from pcc_networks.catalogue import PCGCV1
from pcc_networks.pcgcv1.codec import decode, encode
from pcc_networks.pcgcv1.cubes import (
    blocks_of,
    cubes_of,
    cubes_with_blocks,
    most_likely_per_block,
    pooled,
)
from pcc_networks.pcgcv1.inference import CpuTransforms
from pcc_networks.pcgcv1.model import coded_blocks
from pcc_networks.pcgcv1.training import rate_distortion_loss
from pcc_networks.pcgcv1.weights import Pcgcv1Weights, load_weights
from pcc_networks.weights_file import save_multi_rate
from tests.support.learned_codecs import (
    LMBDAS,
    TINY1,
    endure_damage,
    network1,
    shell,
    torch_threads,
)

pytestmark = pytest.mark.usefixtures("one_thread")
WITH_BLOCKS = TINY1.model_copy(update={"occupied_blocks": True})


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Pcgcv1Weights:
    path = tmp_path_factory.mktemp("supported") / "tiny.safetensors"
    save_multi_rate(path, PCGCV1, network1(WITH_BLOCKS), LMBDAS, {})
    return load_weights(path)


def _voxels(count: int = 300) -> np.ndarray:
    return np.unique(np.random.default_rng(0).integers(-20, 40, (count, 3)), axis=0)


def test_blocks_come_back_as_cubes_and_their_blocks() -> None:
    cubes = cubes_of(_voxels(), 16)
    support = cubes_with_blocks(blocks_of(cubes)[::-1], 16)
    assert np.array_equal(support.positions, cubes.positions)
    corners = np.argwhere(support.blocks)
    result = support.positions[corners[:, 0]] * 4 + corners[:, 1:]
    assert np.array_equal(np.unique(result, axis=0), np.unique(_voxels() // 4, axis=0))


def test_no_cubes_have_no_blocks() -> None:
    support = cubes_with_blocks(np.empty((0, 3), dtype=np.int64), 16)
    assert support.positions.shape == (0, 3)
    assert support.blocks.shape == (0, 4, 4, 4)


def test_eight_blocks_share_a_value_of_the_hyper_latent() -> None:
    blocks = np.random.default_rng(1).random((2, 4, 4, 4)) < 0.1
    expected = max_pool3d(torch.from_numpy(blocks).float(), 2) > 0
    assert np.array_equal(pooled(blocks), expected.numpy())


def test_each_block_keeps_a_voxel_before_the_most_likely_of_all() -> None:
    rng = np.random.default_rng(2)
    logits, blocks = rng.normal(size=16**3).astype(np.float32), rng.random((4, 4, 4)) < 0.2
    keys = most_likely_per_block(logits, blocks, 40)
    places = np.column_stack(np.unravel_index(keys, (16, 16, 16)))
    assert len(keys) == len(set(keys)) == 40
    assert {tuple(place) for place in places // 4} == {tuple(b) for b in np.argwhere(blocks)}
    whole = np.column_stack(np.unravel_index(np.arange(16**3), (16, 16, 16)))
    inside = [int(k) for k in np.flatnonzero(blocks[tuple((whole // 4).T)])]
    first = {max((k for k in inside if tuple(whole[k] // 4) == tuple(b)), key=logits.__getitem__)
             for b in np.argwhere(blocks)}  # fmt: skip
    rest = sorted(set(inside) - first, key=lambda k: -logits[k])[: 40 - len(first)]
    assert set(keys) == first | set(rest)


def test_more_voxels_than_the_blocks_hold_are_not_made() -> None:
    blocks = np.zeros((4, 4, 4), dtype=bool)
    blocks[1, 2, 3] = True
    assert len(most_likely_per_block(np.zeros(16**3, dtype=np.float32), blocks, 1000)) == 64


def test_decoded_points_are_in_the_blocks_of_the_points_and_in_each(
    weights: Pcgcv1Weights,
) -> None:
    points = shell() + np.array([1000, -500, 0])
    decoded = decode(encode(points, weights, 1, point_reconstruction=False), weights)
    assert len(decoded) == len(points)
    assert np.array_equal(np.unique(decoded // 4, axis=0), np.unique(points // 4, axis=0))


def test_the_latent_is_coded_in_blocks_with_voxels_alone(weights: Pcgcv1Weights) -> None:
    model, occupied = network1(WITH_BLOCKS), np.zeros((16, 16, 16), dtype=np.float32)
    occupied[2:6, 9, 9] = 1
    with torch.no_grad():
        model.log_gains.fill_(8)
        model.h_a.conv3.weight.mul_(100)
    y_hat, z_hat = CpuTransforms(model).analyse(occupied, 1)
    assert {tuple(place[1:]) for place in np.argwhere(y_hat)} == {(0, 2, 2), (1, 2, 2)}
    assert {tuple(place[1:]) for place in np.argwhere(z_hat)} == {(0, 1, 1)}


def test_threads_change_nothing(weights: Pcgcv1Weights) -> None:
    points = np.vstack([shell(), shell() + np.array([60, 0, 0])])
    streams, decoded = [], []
    for threads in (1, 2):
        with torch_threads(threads):
            streams.append(encode(points, weights, rate=1))
            decoded.append(decode(streams[0], weights))
    assert streams[0] == streams[1]
    assert np.array_equal(decoded[0], decoded[1])


def test_blocks_without_voxels_cost_nothing_in_training() -> None:
    cubes = torch.zeros(1, 1, 16, 16, 16)
    cubes[:, :, 5] = 1
    with_blocks, original = network1(WITH_BLOCKS), network1()
    assert torch.equal(
        coded_blocks(with_blocks.shape, cubes)[0, 0].mean((1, 2)), torch.tensor([0.0, 1, 0, 0])
    )
    with torch.no_grad():
        less, more = (
            rate_distortion_loss(model, cubes, 1, 4.0, torch.Generator().manual_seed(0))
            for model in (with_blocks, original)
        )
    assert less.bpp < 0.6 * more.bpp
    assert less.hyper_bpp < 0.6 * more.hyper_bpp


@pytest.mark.parametrize("seed", range(3))
def test_damaged_streams_end_in_one_clean_error_or_points(
    weights: Pcgcv1Weights, seed: int
) -> None:
    stream = encode(shell(), weights, 1, point_reconstruction=False)
    endure_damage(lambda damaged: decode(damaged, weights), stream, check=5, seed=seed)

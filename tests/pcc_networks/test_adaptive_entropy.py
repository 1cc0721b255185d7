"""Context-adaptive coding of latents: tables, neighbours, channels coded before."""

import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pcc_networks import pcgcv1, pcgcv2
from pcc_networks.adaptive_entropy import (
    Prior,
    decode_with_contexts,
    encode_with_contexts,
    factorised_prior,
    prior_of,
)
from pcc_networks.entropy_bottleneck import FrequencyTable, encode_latent
from pcc_networks.sparse.voxels import VoxelSet, morton_keys, pyramid
from pointkit.errors import InputError
from tests.support.learned_codecs import save_tiny, shell

LAPLACE = FrequencyTable(
    -6, np.array([1, 4, 16, 64, 256, 1024, 4096, 1024, 256, 64, 16, 4, 1, 1], np.int32)
)


def _plane(side: int) -> VoxelSet:
    """A level plane of voxels, in order."""
    x, y = np.divmod(np.arange(side**2), side)
    keys = np.sort(morton_keys(np.column_stack([x, y, np.zeros_like(x)])))
    return pyramid(keys, 0)[0][0]


def _drawn(count: int, channels: int) -> np.ndarray:
    """Integers as frequent as the table says, each for itself."""
    shares = LAPLACE.frequencies[:-1] / LAPLACE.frequencies[:-1].sum()
    rng = np.random.default_rng(0)
    return rng.choice(np.arange(-6, 7), size=(count, channels), p=shares).astype(np.int32)


def _encoded(latent: np.ndarray, voxels: VoxelSet) -> bytes:
    return encode_with_contexts(latent, voxels.neighbours, _tables(latent))


def _decoded(data: bytes, voxels: VoxelSet, channels: int) -> np.ndarray:
    prior = factorised_prior((LAPLACE,) * channels, len(voxels))
    return decode_with_contexts(data, voxels.neighbours, prior)


def _tables(latent: np.ndarray) -> Prior:
    return factorised_prior((LAPLACE,) * latent.shape[1], len(latent))


def _alone(latent: np.ndarray) -> int:
    """Bytes that the tables alone take."""
    return len(encode_latent(latent, (LAPLACE,) * latent.shape[1]))


@given(arrays(np.int32, (16, 3), elements=st.integers(-65_555, 65_555)))
def test_any_integers_come_back(latent: np.ndarray) -> None:
    assert np.array_equal(_decoded(_encoded(latent, _plane(4)), _plane(4), 3), latent)


def test_a_single_voxel_comes_back() -> None:
    latent = np.array([[2, -1]], np.int32)
    assert np.array_equal(_decoded(_encoded(latent, _plane(1)), _plane(1), 2), latent)


def test_contexts_cost_little_where_neighbours_are_independent() -> None:
    latent = _drawn(64**2, 4)
    assert len(_encoded(latent, _plane(64))) < 1.04 * _alone(latent)


def test_a_latent_that_resembles_its_neighbours_takes_fewer_bits() -> None:
    latent = _drawn(8**2, 1).repeat(64, axis=0)  # the same in blocks of 8 x 8, in Morton order
    assert len(_encoded(latent, _plane(64))) < 0.4 * _alone(latent)


def test_a_channel_that_resembles_the_one_before_takes_fewer_bits() -> None:
    latent = _drawn(64**2, 1).repeat(2, axis=1)
    assert len(_encoded(latent, _plane(64))) < 0.65 * _alone(latent)


def test_contexts_learn_from_the_occupancy_of_neighbours() -> None:
    x = np.arange(0, 4096, 2)
    pairs = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    kept = np.vstack([pairs, pairs[np.random.default_rng(1).random(len(x)) < 0.5] + [0, 1, 0]])
    voxels = pyramid(np.sort(morton_keys(kept)), 0)[0][0]
    latent = np.where((voxels.neighbours >= 0).sum(axis=0) > 1, 2, -2).astype(np.int32)[:, None]
    assert len(_encoded(latent, voxels)) < 0.1 * _alone(latent)


def test_the_prior_may_differ_from_value_to_value() -> None:
    """Integers far from zero that the network knows cost next to nothing."""
    centre = np.random.default_rng(0).integers(-15, 16, (64**2, 2))
    surely = FrequencyTable(-1, np.array([1, 2**20, 1, 1], np.int32))
    prior = prior_of((LAPLACE, surely), np.ones_like(centre), centre)
    voxels, latent = _plane(64), centre.astype(np.int32)
    data = encode_with_contexts(latent, voxels.neighbours, prior)
    assert len(data) < 0.06 * latent.size  # half a bit
    assert np.array_equal(decode_with_contexts(data, voxels.neighbours, prior), latent)


def test_every_machine_writes_the_same_bytes() -> None:
    data = _encoded(_drawn(64, 2).cumsum(axis=0), _plane(8))
    assert (len(data), zlib.crc32(data)) == (61, 1006217149)


@pytest.mark.parametrize("damage", [lambda data: data[:-12], lambda data: data + bytes(12)])
def test_data_that_end_early_or_late_are_refused(damage: Callable[[bytes], bytes]) -> None:
    data = _encoded(_drawn(256, 2), _plane(16))
    with pytest.raises(InputError, match="damaged"):
        _decoded(damage(data), _plane(16), 2)


def test_streams_say_whether_they_were_coded_with_context_mixing(tmp_path: Path) -> None:
    save_tiny("pcgcv1", tmp_path / "1.safetensors")
    save_tiny("pcgcv2", tmp_path / "2.safetensors")
    weights1 = pcgcv1.load_weights(tmp_path / "1.safetensors")
    weights2 = pcgcv2.load_weights(tmp_path / "2.safetensors")
    tools = pcgcv2.CodingTools
    pairs = (
        [
            (pcgcv1.encode(shell(), weights1, 1, context_mixing=mixes), weights1)
            for mixes in (True, False)
        ],
        [
            (pcgcv2.encode(shell(), weights2, 1, tools=used), weights2)
            for used in (tools.CHILD_PER_PARENT | tools.CONTEXT_MIXING, tools.CHILD_PER_PARENT)
        ],
    )
    for library, ((with_them, weights), (without, _)) in zip((pcgcv1, pcgcv2), pairs, strict=True):
        assert with_them != without
        first, second = (library.decode(stream, weights) for stream in (with_them, without))
        assert np.array_equal(first, second)


def test_cubes_too_far_apart_for_contexts_are_coded_without(tmp_path: Path) -> None:
    save_tiny("pcgcv1", tmp_path / "tiny.safetensors")
    weights = pcgcv1.load_weights(tmp_path / "tiny.safetensors")
    far = np.array([2.0**24, 0, 0])
    stream = pcgcv1.encode(np.vstack([shell(), shell() + far]), weights, 1)
    near, beyond = np.split(pcgcv1.decode(stream, weights), 2)
    assert np.array_equal(near + far, beyond)

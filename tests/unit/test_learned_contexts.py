"""Latents coded in contexts: of the tables, of the neighbours, of the channels before."""

import zlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from puckbench.codecs.learned.bottleneck import Table
from puckbench.codecs.learned.coding import encode_latent
from puckbench.codecs.learned.contexts import decode_in_context, encode_in_context
from puckbench.codecs.sparse.voxels import Voxels, morton_keys, pyramid
from puckbench.errors import InputError

LAPLACE = Table(-6, np.array([1, 4, 16, 64, 256, 1024, 4096, 1024, 256, 64, 16, 4, 1, 1], np.int32))


def _plane(side: int) -> Voxels:
    """A level plane of voxels, in order."""
    x, y = np.divmod(np.arange(side**2), side)
    keys = np.sort(morton_keys(np.column_stack([x, y, np.zeros_like(x)])))
    return pyramid(keys, 0)[0][0]


def _drawn(count: int, channels: int) -> np.ndarray:
    """Integers as frequent as the table says, each for itself."""
    shares = LAPLACE.frequencies[:-1] / LAPLACE.frequencies[:-1].sum()
    rng = np.random.default_rng(0)
    return rng.choice(np.arange(-6, 7), size=(count, channels), p=shares).astype(np.int32)


@settings(deadline=None)  # the first example compiles
@given(arrays(np.int32, (16, 3), elements=st.integers(-65_555, 65_555)))
def test_any_integers_come_back(latent: np.ndarray) -> None:
    around, tables = _plane(4).neighbours, (LAPLACE, Table(3, np.array([1, 1])), LAPLACE)
    assert np.array_equal(
        decode_in_context(encode_in_context(latent, around, tables), around, tables), latent
    )


def test_a_single_voxel_comes_back() -> None:
    around, latent = _plane(1).neighbours, np.array([[2, -1]], np.int32)
    data = encode_in_context(latent, around, (LAPLACE,) * 2)
    assert np.array_equal(decode_in_context(data, around, (LAPLACE,) * 2), latent)


def test_where_neighbours_say_nothing_contexts_cost_little() -> None:
    latent, tables = _drawn(64**2, 4), (LAPLACE,) * 4
    alone = len(encode_latent(latent, tables))
    assert len(encode_in_context(latent, _plane(64).neighbours, tables)) < 1.04 * alone


def test_a_latent_like_its_neighbours_takes_fewer_bits() -> None:
    voxels, tables = _plane(64), (LAPLACE,)
    latent = _drawn(8**2, 1).repeat(64, axis=0)  # the same in blocks of 8 x 8, in Morton order
    alone = len(encode_latent(latent, tables))
    assert len(encode_in_context(latent, voxels.neighbours, tables)) < 0.4 * alone


def test_a_channel_like_the_one_before_takes_fewer_bits() -> None:
    latent, tables = _drawn(64**2, 1).repeat(2, axis=1), (LAPLACE,) * 2
    alone = len(encode_latent(latent, tables))
    assert len(encode_in_context(latent, _plane(64).neighbours, tables)) < 0.65 * alone


def test_latents_follow_from_which_neighbours_there_are() -> None:
    x = np.arange(0, 4096, 2)
    pairs = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    kept = np.vstack([pairs, pairs[np.random.default_rng(1).random(len(x)) < 0.5] + [0, 1, 0]])
    voxels = pyramid(np.sort(morton_keys(kept)), 0)[0][0]
    latent = np.where((voxels.neighbours >= 0).sum(axis=0) > 1, 2, -2).astype(np.int32)[:, None]
    alone = len(encode_latent(latent, (LAPLACE,)))
    assert len(encode_in_context(latent, voxels.neighbours, (LAPLACE,))) < 0.1 * alone


def test_every_machine_writes_the_same_bytes() -> None:
    data = encode_in_context(_drawn(64, 2).cumsum(axis=0), _plane(8).neighbours, (LAPLACE,) * 2)
    assert (len(data), zlib.crc32(data)) == (61, 1006217149)


@pytest.mark.parametrize("damage", [lambda data: data[:-12], lambda data: data + bytes(12)])
def test_data_that_end_early_or_late_are_refused(damage: Callable[[bytes], bytes]) -> None:
    around = _plane(16).neighbours
    data = encode_in_context(_drawn(256, 2), around, (LAPLACE,) * 2)
    with pytest.raises(InputError, match="damaged"):
        decode_in_context(damage(data), around, (LAPLACE,) * 2)

"""Coding symbols by the network's word and the cloud's own habits."""

import zlib

import numpy as np
import pytest

from puckbench.codecs.common.binary_coder import (
    ONE,
    bit_reader,
    bit_writer,
    code,
    logistic_tables,
    read_to_its_end,
    written,
)
from puckbench.codecs.learned.octree_net.causal_neighbourhood import known_of, look_around
from puckbench.codecs.learned.octree_net.mixing import code_symbols, reader, writer
from puckbench.codecs.learned.octree_net.symbols import groups_of
from puckbench.codecs.learned.sparse.voxels import Table, pyramid

KEYS = np.arange(8**4)  # a full cube of 16 voxels' side


def _neighbours(keys: np.ndarray = KEYS) -> Table:
    return pyramid(keys, 0)[0][0].neighbours


def _coded(symbols: np.ndarray, said: np.ndarray) -> bytes:
    """Symbols (2, n) of all voxels, of which the network says `said` (2, n, 16)."""
    mixer, level = writer(len(KEYS)), known_of(_neighbours())
    for group, rows in enumerate(groups_of(KEYS)):
        look_around(level, rows)
        for half in (0, 1):
            code_symbols(
                mixer, level, group, half == 1, rows, symbols[half, rows], said[half, rows]
            )
    return written(mixer.bits)


def _decoded(stream: bytes, said: np.ndarray) -> np.ndarray:
    mixer, level = reader(stream), known_of(_neighbours())
    symbols = np.zeros(said.shape[:2], dtype=np.uint8)
    for group, rows in enumerate(groups_of(KEYS)):
        look_around(level, rows)
        for half in (0, 1):
            read = np.zeros(len(rows), dtype=np.uint8)
            code_symbols(mixer, level, group, half == 1, rows, read, said[half, rows])
            symbols[half, rows] = read
    assert read_to_its_end(mixer.bits)
    return symbols


def _drawn(said: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Symbols that are as frequent as is said."""
    below = np.cumsum(said, axis=-1) / said.sum(axis=-1, keepdims=True)
    found = (rng.random(said.shape[:2])[..., None] > below).sum(axis=-1)
    return np.asarray(found.clip(0, 15), dtype=np.uint8)


def _said(rng: np.random.Generator) -> np.ndarray:
    size = (2, len(KEYS), 16)
    return (8 + (rng.integers(0, 65528, size) >> rng.integers(0, 14, size))).astype(np.int32)


def test_symbols_come_back() -> None:
    rng = np.random.default_rng(0)
    said = _said(rng)
    symbols = rng.integers(0, 16, (2, len(KEYS)), dtype=np.uint8)
    assert np.array_equal(_decoded(_coded(symbols, said), said), symbols)


def test_where_the_network_is_right_nothing_is_lost() -> None:
    rng = np.random.default_rng(1)
    said = _said(rng)
    symbols = _drawn(said, rng)
    shares = np.take_along_axis(said, symbols[..., None].astype(int), axis=-1)[..., 0]
    least = np.log2(said.sum(axis=-1) / shares).sum()
    assert 8 * len(_coded(symbols, said)) == pytest.approx(least, rel=0.05)


def test_what_the_network_does_not_know_is_learnt() -> None:
    said = np.ones((2, len(KEYS), 16), dtype=np.int32)
    symbols = np.stack([np.full(len(KEYS), 9), np.full(len(KEYS), 6)]).astype(np.uint8)
    assert len(_coded(symbols, said)) < 0.1 * len(KEYS)


def test_a_neighbours_children_tell_of_those_beside_them() -> None:
    """Noise of which both sides of each face between two voxels are alike."""
    rng = np.random.default_rng(2)
    said = np.ones((2, len(KEYS), 16), dtype=np.int32)
    alike = np.where(rng.random(len(KEYS) // 512) < 0.5, 15, 0).repeat(512)
    plain = np.where(rng.random(len(KEYS)) < 0.5, 15, 0)
    near, far = (_coded(np.stack([s, s]).astype(np.uint8), said) for s in (alike, plain))
    assert len(near) < 0.5 * len(far)


def test_the_format_does_not_change_unnoticed() -> None:
    rng = np.random.default_rng(3)
    said = _said(rng)
    stream = _coded(_drawn(said, rng), said)
    assert zlib.crc32(stream) == 2516204787


def test_tables_do_not_hang_on_the_last_bit_of_a_logarithm() -> None:
    """No entry is so near to a half that a library's rounding could decide."""
    chances = (np.arange(4096) + 0.5) / 4096
    logits = 256 * np.log(chances / (1 - chances))
    shares = ONE / (1 + np.exp(-np.arange(-2048, 2048) / 256))
    for values in (logits, shares):
        assert np.abs(values - np.floor(values) - 0.5).min() > 1e-6
    stretch, squash = logistic_tables()
    assert np.abs(stretch - logits.clip(-2048, 2047)).max() <= 0.5
    assert np.abs(squash - shares.clip(32, ONE - 32)).max() <= 0.5


@pytest.mark.parametrize("chance", [1, 300, 32768, ONE - 1])
def test_bits_cost_what_their_chance_says(chance: int) -> None:
    bits = np.random.default_rng(4).random(20_000) < chance / ONE
    coder = bit_writer(50_000)
    for bit in bits:
        code(coder, int(bit), chance)
    stream, p = written(coder), chance / ONE
    ones = int(bits.sum())
    least = -ones * np.log2(p) - (len(bits) - ones) * np.log2(1 - p)
    assert 8 * len(stream) == pytest.approx(least, rel=0.01, abs=40)
    back = bit_reader(stream)
    assert [code(back, 0, chance) for _ in bits] == bits.astype(int).tolist()
    assert read_to_its_end(back)


def test_a_stream_with_bytes_to_spare_is_not_read_to_its_end() -> None:
    coder = bit_writer(100)
    for bit in (1, 0, 1):
        code(coder, bit, 20_000)
    back = bit_reader(written(coder) + b"\1" * 9)
    for _ in range(3):
        code(back, 0, 20_000)
    assert not read_to_its_end(back)

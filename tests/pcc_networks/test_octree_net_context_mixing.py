"""Coding symbols with the network's probabilities and the cloud's adaptive statistics."""

import zlib

import numpy as np
import pytest

from pcc_networks.octree_net.causal_neighbourhood import empty_state, find_neighbourhood
from pcc_networks.octree_net.mixing import code_symbols, reader, writer
from pcc_networks.octree_net.symbols import groups_of
from pcc_networks.sparse.voxels import NeighbourTable, pyramid
from pointkit.coding.binary_coder import (
    ONE,
    bit_reader,
    bit_writer,
    code,
    logistic_tables,
    read_to_its_end,
    written,
)

KEYS = np.arange(8**4)  # a full cube of 16 voxels' side


def _neighbours(keys: np.ndarray = KEYS) -> NeighbourTable:
    return pyramid(keys, 0)[0][0].neighbours


def _coded(symbols: np.ndarray, predicted: np.ndarray) -> bytes:
    """Symbols (2, n) of all voxels, with the frequencies `predicted` by the network (2, n, 16)."""
    mixer, level = writer(len(KEYS)), empty_state(_neighbours())
    for group, rows in enumerate(groups_of(KEYS)):
        find_neighbourhood(level, rows)
        for half in (0, 1):
            code_symbols(
                mixer, level, group, half == 1, rows, symbols[half, rows], predicted[half, rows]
            )
    return written(mixer.bits)


def _decoded(stream: bytes, predicted: np.ndarray) -> np.ndarray:
    mixer, level = reader(stream), empty_state(_neighbours())
    symbols = np.zeros(predicted.shape[:2], dtype=np.uint8)
    for group, rows in enumerate(groups_of(KEYS)):
        find_neighbourhood(level, rows)
        for half in (0, 1):
            read = np.zeros(len(rows), dtype=np.uint8)
            code_symbols(mixer, level, group, half == 1, rows, read, predicted[half, rows])
            symbols[half, rows] = read
    assert read_to_its_end(mixer.bits)
    return symbols


def _drawn(predicted: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Symbols drawn with the predicted frequencies."""
    below = np.cumsum(predicted, axis=-1) / predicted.sum(axis=-1, keepdims=True)
    result = (rng.random(predicted.shape[:2])[..., None] > below).sum(axis=-1)
    return np.asarray(result.clip(0, 15), dtype=np.uint8)


def _predicted(rng: np.random.Generator) -> np.ndarray:
    size = (2, len(KEYS), 16)
    return (8 + (rng.integers(0, 65528, size) >> rng.integers(0, 14, size))).astype(np.int32)


def test_symbols_come_back() -> None:
    rng = np.random.default_rng(0)
    predicted = _predicted(rng)
    symbols = rng.integers(0, 16, (2, len(KEYS)), dtype=np.uint8)
    assert np.array_equal(_decoded(_coded(symbols, predicted), predicted), symbols)


def test_context_mixing_costs_nothing_where_the_network_is_right() -> None:
    rng = np.random.default_rng(1)
    predicted = _predicted(rng)
    symbols = _drawn(predicted, rng)
    shares = np.take_along_axis(predicted, symbols[..., None].astype(int), axis=-1)[..., 0]
    least = np.log2(predicted.sum(axis=-1) / shares).sum()
    assert 8 * len(_coded(symbols, predicted)) == pytest.approx(least, rel=0.05)


def test_adaptive_statistics_learn_what_the_network_does_not_know() -> None:
    predicted = np.ones((2, len(KEYS), 16), dtype=np.int32)
    symbols = np.stack([np.full(len(KEYS), 9), np.full(len(KEYS), 6)]).astype(np.uint8)
    assert len(_coded(symbols, predicted)) < 0.1 * len(KEYS)


def test_children_are_predicted_from_their_causal_neighbourhood() -> None:
    """Noise of which both sides of each face between two voxels are alike."""
    rng = np.random.default_rng(2)
    predicted = np.ones((2, len(KEYS), 16), dtype=np.int32)
    alike = np.where(rng.random(len(KEYS) // 512) < 0.5, 15, 0).repeat(512)
    plain = np.where(rng.random(len(KEYS)) < 0.5, 15, 0)
    near, far = (_coded(np.stack([s, s]).astype(np.uint8), predicted) for s in (alike, plain))
    assert len(near) < 0.5 * len(far)


def test_the_format_does_not_change_unnoticed() -> None:
    rng = np.random.default_rng(3)
    predicted = _predicted(rng)
    stream = _coded(_drawn(predicted, rng), predicted)
    assert zlib.crc32(stream) == 2516204787


def test_tables_do_not_hang_on_the_last_bit_of_a_logarithm() -> None:
    """No entry is so near to a half that a library's rounding could decide."""
    probabilities = (np.arange(4096) + 0.5) / 4096
    logits = 256 * np.log(probabilities / (1 - probabilities))
    shares = ONE / (1 + np.exp(-np.arange(-2048, 2048) / 256))
    for values in (logits, shares):
        assert np.abs(values - np.floor(values) - 0.5).min() > 1e-6
    stretch, squash = logistic_tables()
    assert np.abs(stretch - logits.clip(-2048, 2047)).max() <= 0.5
    assert np.abs(squash - shares.clip(32, ONE - 32)).max() <= 0.5


@pytest.mark.parametrize("probability", [1, 300, 32768, ONE - 1])
def test_bits_cost_what_their_probability_says(probability: int) -> None:
    bits = np.random.default_rng(4).random(20_000) < probability / ONE
    coder = bit_writer(50_000)
    for bit in bits:
        code(coder, int(bit), probability)
    stream, p = written(coder), probability / ONE
    ones = int(bits.sum())
    least = -ones * np.log2(p) - (len(bits) - ones) * np.log2(1 - p)
    assert 8 * len(stream) == pytest.approx(least, rel=0.01, abs=40)
    back = bit_reader(stream)
    assert [code(back, 0, probability) for _ in bits] == bits.astype(int).tolist()
    assert read_to_its_end(back)


def test_a_stream_with_bytes_to_spare_is_not_read_to_its_end() -> None:
    coder = bit_writer(100)
    for bit in (1, 0, 1):
        code(coder, bit, 20_000)
    back = bit_reader(written(coder) + b"\1" * 9)
    for _ in range(3):
        code(back, 0, 20_000)
    assert not read_to_its_end(back)

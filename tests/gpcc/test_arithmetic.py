"""The arithmetic coder against exact arithmetic on whole numbers."""

import math
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcc.arithmetic import (
    ADAPTATION,
    HALF,
    Encoder,
    code_bit,
    code_bypass,
    code_exp_golomb,
    consumed,
    decoder,
    encoder,
    enlarged,
    finish,
    restart,
)

MODELS = 3
BYPASS = 3


@numba.njit
def _code(coder: Any, which: np.ndarray, bits: np.ndarray) -> np.ndarray:
    coded = np.empty(len(bits), dtype=np.int64)
    for i in range(len(bits)):
        if which[i] == BYPASS:
            coded[i] = code_bypass(coder, bits[i])
        else:
            coded[i] = code_bit(coder, which[i], bits[i])
    return coded


@numba.njit
def _code_numbers(coder: Any, numbers: np.ndarray) -> np.ndarray:
    coded = np.empty(len(numbers), dtype=np.int64)
    for i in range(len(numbers)):
        coded[i] = code_exp_golomb(coder, 0, numbers[i])
    return coded


def _fresh() -> np.ndarray:
    return np.full(MODELS, HALF, dtype=np.uint16)


def _encoded(which: np.ndarray, bits: np.ndarray) -> bytes:
    coder = encoder(_fresh(), 64 + 2 * len(bits))
    _code(coder, which, bits)
    return finish(coder)


def _interval(which: list[int], bits: list[int]) -> tuple[int, int, int, float]:
    """Exact interval (low, width) of a sequence in units of 2**-n, n, and its ideal length."""
    low, width, places, ideal = 0, 0xFFFF, 16, 0.0
    models = [HALF] * (MODELS + 1)
    for model, bit in zip(which, bits, strict=True):
        p = models[model]
        split = width * p >> 16
        ideal -= math.log2(1 - p / 65536 if bit else p / 65536)
        low, width = (low + split, width - split) if bit else (low, split)
        if model != BYPASS:
            change = ADAPTATION[p >> 8] if bit else ADAPTATION[255 - (p >> 8)]
            models[model] += -int(change) if bit else int(change)
        while width <= 0x4000:
            low, width, places = 2 * low, 2 * width, places + 1
    return low, width, places, ideal


SYMBOLS = st.lists(st.tuples(st.integers(0, BYPASS), st.integers(0, 1)), max_size=300)


@settings(max_examples=200)
@given(SYMBOLS)
def test_the_bytes_lie_in_the_exact_interval_of_the_bits(symbols: list[tuple[int, int]]) -> None:
    which, bits = [s[0] for s in symbols], [s[1] for s in symbols]
    data = _encoded(np.array(which, dtype=np.int64), np.array(bits, dtype=np.int64))
    low, width, places, _ = _interval(which, bits)
    shift = 8 * len(data) - places
    assert low << shift <= int.from_bytes(data) < low + width << shift


@settings(max_examples=200)
@given(SYMBOLS, st.integers(0, 1))
def test_bits_come_back(symbols: list[tuple[int, int]], ones: int) -> None:
    which = np.array([s[0] for s in symbols], dtype=np.int64)
    bits = np.array([s[1] | ones for s in symbols], dtype=np.int64)
    data = _encoded(which, bits)
    coder = decoder(_fresh(), np.frombuffer(data, dtype=np.uint8))
    assert (_code(coder, which, np.zeros_like(bits)) == bits).all()
    assert consumed(coder) <= len(data)


@pytest.mark.parametrize("ones", [0.01, 0.2, 0.5, 0.97])
def test_the_length_is_that_of_the_adaptive_models(ones: float) -> None:
    random = np.random.default_rng(3)
    bits = (random.random(20_000) < ones).astype(np.int64)
    which = random.integers(0, MODELS, len(bits))
    *_, ideal = _interval(which.tolist(), bits.tolist())
    length = 8 * len(_encoded(which, bits))
    assert ideal <= length + 1 <= 1.001 * ideal + 24


def test_bypass_bits_cost_one_bit() -> None:
    bits = np.random.default_rng(0).integers(0, 2, 8_000)
    data = _encoded(np.full(8_000, BYPASS), bits)
    assert 1_000 <= len(data) <= 1_003


@settings(max_examples=100)
@given(st.lists(st.integers(0, 2**24 - 2), max_size=30))
def test_exp_golomb_numbers_come_back(numbers: list[int]) -> None:
    coder = encoder(_fresh(), 64 + 60 * len(numbers))
    values = np.array(numbers, dtype=np.int64)
    _code_numbers(coder, values)
    data = np.frombuffer(finish(coder), dtype=np.uint8)
    assert (_code_numbers(decoder(_fresh(), data), np.zeros_like(values)) == values).all()


def test_a_second_stream_follows_the_first() -> None:
    random = np.random.default_rng(1)
    which = random.integers(0, 4, 500)
    first, second = random.integers(0, 2, (2, 500))
    both = np.frombuffer(_encoded(which, first) + _encoded(which, second), dtype=np.uint8)
    coder = decoder(_fresh(), both)
    assert (_code(coder, which, first * 0) == first).all()
    restart(coder)
    coder.contexts[:] = HALF
    assert (_code(coder, which, second * 0) == second).all()


def test_an_enlarged_encoder_keeps_what_it_wrote() -> None:
    random = np.random.default_rng(2)
    which, bits = np.zeros(2_000, dtype=np.int64), random.integers(0, 2, 2_000)
    coder = encoder(_fresh(), 600)
    _code(coder, which[:1_000], bits[:1_000])
    coder = enlarged(coder, 600)
    assert isinstance(coder, Encoder)
    _code(coder, which[1_000:], bits[1_000:])
    assert finish(coder) == _encoded(which, bits)

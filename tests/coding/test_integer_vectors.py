"""Sums and updates of short integer vectors against numpy."""

import numpy as np
import pytest
from numpy.typing import NDArray

from puckbench.coding.integer_vectors import (
    add_scaled,
    as_vector,
    decay_and_add,
    dot,
    lanes_for,
)
from puckbench.core.compiling import compiled

Words = NDArray[np.int32]
Many = tuple[int, ...]


def words(count: int, seed: int) -> Words:
    random = np.random.default_rng(seed)
    return random.integers(-(2**31), 2**31, count).astype(np.int32)


def summed(left: Words, right: Words, lanes: Many) -> int:
    as_vector(right, lanes)
    return int(dot(left, 5, right, 0, lanes))


def scaled(onto: Words, numbers: Words, factor: int, lanes: Many) -> None:
    add_scaled(onto, 5, numbers, factor, 18, lanes)


def decayed(onto: Words, numbers: Words, factor: int, lanes: Many) -> None:
    decay_and_add(onto, 5, numbers, factor, 3, 7, lanes)


def test_a_vector_has_a_multiple_of_eight_numbers() -> None:
    assert [len(lanes_for(count)) for count in (1, 8, 9, 14, 24)] == [8, 8, 16, 16, 24]


@pytest.mark.parametrize("numbers", [3, 8, 14, 22])
def test_products_are_summed_in_64_bits(numbers: int) -> None:
    lanes = lanes_for(numbers)
    left, right = words(5 + len(lanes), 1), words(len(lanes), 2)
    products = (int(a) * int(b) for a, b in zip(left[5:], right, strict=True))
    expected = (sum(products) + 2**63) % 2**64 - 2**63
    kept = right.copy()
    assert compiled(summed)(left, right, lanes) == expected
    np.testing.assert_array_equal(right, kept)


@pytest.mark.parametrize("factor", [-1_600_000, 0, 77, 1_600_000])
@pytest.mark.parametrize("numbers", [3, 14])
def test_scaled_numbers_are_rounded_and_added(numbers: int, factor: int) -> None:
    lanes = lanes_for(numbers)
    onto, steps = words(10 + len(lanes), 3) >> 4, words(len(lanes), 4) >> 20
    expected = onto.copy()
    expected[5 : 5 + len(lanes)] += np.floor(steps * float(factor) / 2**18 + 0.5).astype(np.int32)
    compiled(scaled)(onto, steps, factor, lanes)
    np.testing.assert_array_equal(onto, expected)


@pytest.mark.parametrize("factor", [-960, 1, 960])
@pytest.mark.parametrize("numbers", [10, 22])
def test_sums_decay_and_grow(numbers: int, factor: int) -> None:
    lanes = lanes_for(numbers)
    onto, steps = words(10 + len(lanes), 5) >> 2, words(len(lanes), 6) >> 21
    expected = onto.copy()
    part = slice(5, 5 + len(lanes))
    expected[part] += (np.floor(steps * factor / 8) - np.floor(onto[part] / 128)).astype(np.int32)
    compiled(decayed)(onto, steps, factor, lanes)
    np.testing.assert_array_equal(onto, expected)

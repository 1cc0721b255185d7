"""The vector code against numpy, and against the plain loops that stand in for it."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.coding import intrinsics
from pointkit.compiling import compiled

Words, Floats = NDArray[np.int32], NDArray[np.float32]
LOOPS = {name: compiled(getattr(intrinsics, f"{name}_loop")) for name in (
    "add_scaled", "decay_and_add", "add_products", "copy_floats", "add_floats")}  # fmt: skip


def _words(count: int, seed: int) -> Words:
    return np.random.default_rng(seed).integers(-(2**31), 2**31, count).astype(np.int32)


def _scaled(onto: Words, numbers: Words, factor: int, lanes: intrinsics.Lanes) -> None:
    intrinsics.add_scaled(onto, 5, numbers, factor, 18, lanes)


def _decayed(onto: Words, numbers: Words, factor: int, lanes: intrinsics.Lanes) -> None:
    intrinsics.decay_and_add(onto, 5, numbers, factor, 3, 7, lanes)


def test_a_vector_has_a_multiple_of_eight_numbers() -> None:
    assert [len(intrinsics.lanes_for(count)) for count in (1, 8, 9, 14, 24)] == [8, 8, 16, 16, 24]


@pytest.mark.parametrize("factor", [-1_600_000, 0, 77, 1_600_000])
@pytest.mark.parametrize("count", [3, 14])
def test_scaled_numbers_are_rounded_and_added(count: int, factor: int) -> None:
    lanes = intrinsics.lanes_for(count)
    before, steps = _words(10 + len(lanes), 3) >> 4, _words(len(lanes), 4) >> 20
    expected, onto, by_loop = before.copy(), before.copy(), before.copy()
    expected[5 : 5 + len(lanes)] += np.floor(steps * float(factor) / 2**18 + 0.5).astype(np.int32)
    compiled(_scaled)(onto, steps, factor, lanes)
    LOOPS["add_scaled"](by_loop, 5, steps, factor, 18, lanes)
    np.testing.assert_array_equal(onto, expected)
    np.testing.assert_array_equal(by_loop, expected)


@pytest.mark.parametrize("factor", [-960, 1, 960])
@pytest.mark.parametrize("count", [10, 22])
def test_sums_decay_and_grow(count: int, factor: int) -> None:
    lanes = intrinsics.lanes_for(count)
    before, steps = _words(10 + len(lanes), 5) >> 2, _words(len(lanes), 6) >> 21
    expected, onto, by_loop = before.copy(), before.copy(), before.copy()
    part = slice(5, 5 + len(lanes))
    growth = np.floor(steps * factor / 8) - np.floor(before[part] / 128)
    expected[part] += growth.astype(np.int32)
    compiled(_decayed)(onto, steps, factor, lanes)
    LOOPS["decay_and_add"](by_loop, 5, steps, factor, 3, 7, lanes)
    np.testing.assert_array_equal(onto, expected)
    np.testing.assert_array_equal(by_loop, expected)


CASES = ((_scaled, "add_scaled", (18,)), (_decayed, "decay_and_add", (3, 7)))


def test_integers_wrap_alike_in_vectors_and_loops() -> None:
    lanes, factor = intrinsics.lanes_for(16), 2**31 - 5
    onto, numbers = _words(30, 7), _words(16, 8)
    for function, name, shifts in CASES:
        wrapped, by_loop = onto.copy(), onto.copy()
        compiled(function)(wrapped, numbers, factor, lanes)
        LOOPS[name](by_loop, 5, numbers, factor, *shifts, lanes)
        np.testing.assert_array_equal(wrapped, by_loop)


def _multiply(sums: Any, targets: Any, read: Any, sources: Any, pairs: int, kernel: Any) -> None:
    intrinsics.add_products(sums, targets, read, sources, pairs, kernel, 15, 5, 3)


MULTIPLY = compiled(_multiply)


def _operands(pairs: int) -> tuple[Any, Any, Any, Any, int, Any]:
    """Sums (12, 3), targets, features (20, 5), sources, the number of pairs, two matrices."""
    rng = np.random.default_rng(pairs)
    sums, read, kernel = (rng.normal(size=size).astype(np.float32) for size in (36, 100, 30))
    return sums, rng.permutation(12)[:9], read, rng.integers(0, 20, 9), pairs, kernel


@pytest.mark.parametrize("pairs", [0, 1, 3, 4, 9])
def test_exact_products_are_those_of_matrices(pairs: int) -> None:
    sums, targets, read, sources, _, kernel = _operands(pairs)
    sums, read, kernel = (np.rint(100 * array) for array in (sums, read, kernel))
    expected = sums.reshape(12, 3).copy()
    expected[targets[:pairs]] += read.reshape(20, 5)[sources[:pairs]] @ kernel.reshape(2, 5, 3)[1]
    by_loop = sums.copy()
    MULTIPLY(sums, targets, read, sources, pairs, kernel)
    LOOPS["add_products"](by_loop, targets, read, sources, pairs, kernel, 15, 5, 3)
    np.testing.assert_array_equal(sums.reshape(12, 3), expected)
    np.testing.assert_array_equal(by_loop.reshape(12, 3), expected)


@pytest.mark.parametrize("pairs", [0, 1, 3, 4, 9])
def test_fused_products_have_the_same_bits_as_their_loop(pairs: int) -> None:
    sums, *operands = _operands(pairs)
    by_loop = sums.copy()
    MULTIPLY(sums, *operands)
    LOOPS["add_products"](by_loop, *operands, 15, 5, 3)
    np.testing.assert_array_equal(sums.view(np.int32), by_loop.view(np.int32))


def _fused(a: np.float32, b: np.float32, c: np.float32) -> np.float32:
    return intrinsics.fused_multiply_add(a, b, c)


FUSED = compiled(_fused)


@pytest.mark.parametrize(
    ("a", "b", "c"),
    [
        (1 + 2**-12, 1 + 2**-12, -1.0),  # a product of 25 bits
        (1 + 2**-23, 1 - 2**-23, -1.0),
        (2**-60, 2**-60, 1 + 2**-23),  # a sum beside a single number
        (1 + 2**-23, 2**-24, 1.0),  # beside the middle of two
        (-(1 + 2**-23), 2**-24, 1.0),
        (1 - 2**-24, 2**-24, 1.0),
        (2**-70, 2**-70, 2**-127),  # subnormal
        (1.5, -2.0, 3.0),
        (2.0**100, 2.0**100, 1.0),
    ],
)
def test_a_fused_multiplication_and_addition_is_rounded_once(a: float, b: float, c: float) -> None:
    result = FUSED(*map(np.float32, (a, b, c)))
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    if abs(exact) >= 2**128:
        assert np.isinf(result)
        return
    neighbours = [np.nextafter(result, np.float32(side)) for side in (-np.inf, np.inf)]
    distance = abs(Fraction(float(result)) - exact)
    assert all(distance <= abs(Fraction(float(other)) - exact) for other in neighbours)


def test_loops_stand_in_for_vector_code_that_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: Any) -> None:
        raise AttributeError

    monkeypatch.setattr(intrinsics, "_parts", fail)
    monkeypatch.setattr(intrinsics._Products, "block", fail)
    lanes, onto, steps = intrinsics.lanes_for(8), _words(20, 1), _words(8, 2)

    def scaled(onto: Words, numbers: Words, factor: int, lanes: intrinsics.Lanes) -> None:
        intrinsics.add_scaled(onto, 2, numbers, factor, 9, lanes)

    by_loop = onto.copy()
    compiled(scaled)(onto, steps, 3, lanes)
    LOOPS["add_scaled"](by_loop, 2, steps, 3, 9, lanes)
    np.testing.assert_array_equal(onto, by_loop)
    sums, *operands = _operands(9)
    by_loop = sums.copy()
    function = intrinsics.add_products

    def multiply(sums: Any, targets: Any, read: Any, sources: Any, pairs: int, kernel: Any) -> None:
        function(sums, targets, read, sources, pairs, kernel, 0, 10, 3)

    compiled(multiply)(sums, *operands)
    LOOPS["add_products"](by_loop, *operands, 0, 10, 3)
    np.testing.assert_array_equal(sums, by_loop)


@pytest.mark.parametrize("width", [1, 4, 7, 32, 33, 64])
@pytest.mark.parametrize("is_sum", [False, True])
def test_floats_are_copied_and_added(width: int, is_sum: bool) -> None:
    move = intrinsics.add_floats if is_sum else intrinsics.copy_floats

    def moved(onto: Floats, source: Floats) -> None:
        move(onto, 3, source, 2, width)

    random = np.random.default_rng(7)
    before, source = (random.normal(size=70).astype(np.float32) for _ in range(2))
    expected, onto, by_loop = before.copy(), before.copy(), before.copy()
    expected[3 : 3 + width] = source[2 : 2 + width] + (before[3 : 3 + width] if is_sum else 0)
    compiled(moved)(onto, source)
    LOOPS["add_floats" if is_sum else "copy_floats"](by_loop, 3, source, 2, width)
    np.testing.assert_array_equal(onto, expected)
    np.testing.assert_array_equal(by_loop, expected)

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.intrinsics import bit_count, dot, leading_zeros
from pointkit.compiling import compiled

RANDOM = np.random.default_rng(3)
WORDS = [*RANDOM.integers(-(2**63), 2**63, 50).tolist(), *(1 << k for k in range(63)), 0, -1]


@compiled
def _bit_counts(words: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.array([bit_count(word) for word in words])


@compiled
def _leading_zeros(words: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.array([leading_zeros(word) for word in words])


@compiled
def _dot(left: NDArray[np.int32], right: NDArray[np.int32], lanes: tuple[int, ...]) -> int:
    return dot(left, 5, right, 1, lanes)


def test_set_bits_are_counted() -> None:
    assert _bit_counts(np.array(WORDS)).tolist() == [(word % 2**64).bit_count() for word in WORDS]


def test_leading_zeros_are_those_of_python() -> None:
    assert _leading_zeros(np.array(WORDS)).tolist() == [
        64 - (word % 2**64).bit_length() for word in WORDS
    ]


def test_products_are_summed_in_64_bits() -> None:
    left, right = RANDOM.integers(-(2**31), 2**31, (2, 40)).astype(np.int32)
    products = (int(a) * int(b) for a, b in zip(left[5:29], right[1:25], strict=True))
    assert _dot(left, right, (0,) * 24) == (sum(products) + 2**63) % 2**64 - 2**63

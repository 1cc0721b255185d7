"""Integer square roots and arc tangents, against floating-point ones; leading zeros."""

import math

import numpy as np

from gpcc.compiled import compiled
from gpcc.fixed_point import arc_tangent, inverse_square_root
from pointkit.coding.intrinsics import leading_zeros


@compiled
def _roots(numbers: np.ndarray) -> np.ndarray:
    return np.array([inverse_square_root(number) for number in numbers])


@compiled
def _angles(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.array([arc_tangent(y[i], x[i]) for i in range(len(x))])


@compiled
def _zeros(numbers: np.ndarray) -> np.ndarray:
    return np.array([leading_zeros(number) for number in numbers])


def _numbers() -> np.ndarray:
    """Of every length: around powers of two, and at random."""
    random = np.random.default_rng(0)
    powers = [(1 << bits) + change for bits in range(62) for change in (-1, 0, 1)]
    several = [int(random.integers(1 << bits, 2 << bits)) for bits in range(61) for _ in range(50)]
    return np.array([number for number in powers + several if number > 0], dtype=np.int64)


def test_leading_zeros_are_those_of_python() -> None:
    numbers = _numbers()
    assert _zeros(numbers).tolist() == [64 - int(number).bit_length() for number in numbers]
    assert _zeros(np.array([0, -1])).tolist() == [64, 0]


def test_inverse_square_roots_are_right_to_four_digits_or_one_unit() -> None:
    numbers = _numbers()
    exact = 2.0**40 / np.sqrt(numbers.astype(float))
    assert (np.abs(_roots(numbers) - exact) <= 1 + 1e-4 * exact).all()
    assert _roots(np.array([0, -5])).tolist() == [0, 0]


def test_arc_tangents_are_right_to_a_ten_thousandth() -> None:
    random = np.random.default_rng(1)
    for bits in range(2, 24):
        x, y = random.integers(-(1 << bits), 1 << bits, (2, 500))
        angles = _angles(y, x)
        assert np.abs(angles / 2**20 - np.arctan2(y, x)).max() < 2e-4 * math.pi


def test_arc_tangents_of_diagonals_stay_within_their_table() -> None:
    """Where both sides are equal the sine is the largest, and a rounded root may exceed it."""
    sides = np.unique(
        np.concatenate([np.arange(1, 5000), 1 << np.arange(30), (1 << np.arange(1, 30)) - 1])
    )
    assert np.abs(_angles(sides, sides) / 2**20 - math.pi / 4).max() < 2e-4

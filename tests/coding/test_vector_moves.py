"""Copies and sums of short vectors against numpy."""

import numpy as np
import pytest
from numpy.typing import NDArray

from puckbench.coding.vector_moves import add_vector, copy_vector
from puckbench.core.compiling import compiled


@pytest.mark.parametrize("width", [1, 3, 4, 8, 32, 33, 100])
def test_vectors_of_any_width_are_copied_and_added_at_any_place(width: int) -> None:
    def move(onto: NDArray[np.float32], source: NDArray[np.float32], i: int, j: int) -> None:
        copy_vector(onto, i, source, j, width)
        add_vector(onto, i + width, source, j, width)

    random = np.random.default_rng(width)
    onto, source = random.random((2, 300), np.float32)
    expected = onto.copy()
    expected[7 : 7 + width] = source[5 : 5 + width]
    expected[7 + width : 7 + 2 * width] += source[5 : 5 + width]
    compiled(move)(onto, source, 7, 5)
    np.testing.assert_array_equal(onto, expected)

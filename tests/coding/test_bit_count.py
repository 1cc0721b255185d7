import numba
import numpy as np

from puckbench.coding.bit_count import bit_count


@numba.njit
def _counted(word: int) -> int:
    return bit_count(word)


def test_set_bits_are_counted() -> None:
    words = [*np.random.default_rng(3).integers(-(2**63), 2**63, 50).tolist(), 0, -1]
    assert [_counted(word) for word in words] == [(word % 2**64).bit_count() for word in words]

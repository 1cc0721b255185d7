from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import inlined


@inlined
def bit_count(word: int) -> int:
    """Return the number of set bits of a 64-bit word."""
    pairs = word - ((word >> 1) & 0x5555555555555555)
    fours = (pairs & 0x3333333333333333) + ((pairs >> 2) & 0x3333333333333333)
    eights = (fours + (fours >> 4)) & 0x0F0F0F0F0F0F0F0F
    return (eights * 0x0101010101010101) >> 56


@inlined
def dot(
    left: NDArray[np.int32], i: int, right: NDArray[np.int32], j: int, lanes: tuple[int, ...]
) -> int:
    total = np.int64(0)
    for k in range(len(lanes)):
        total += np.int64(left[np.uint64(i + k)]) * np.int64(right[np.uint64(j + k)])
    return int(total)

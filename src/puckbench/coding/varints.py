from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError

_LONGEST = 5
_PORTION = 1 << 20
"""Numbers unpacked at a time, which limits the memory for intermediate arrays."""
Numbers = NDArray[np.int64]


def packed_signed(numbers: Numbers) -> bytes:
    """Encode numbers (n,) of at most 34 bits and a sign, each like `byte_io.signed_128`."""
    zigzag = np.where(numbers >= 0, 2 * numbers, -2 * numbers - 1)
    groups = zigzag[:, None] >> np.arange(0, 7 * _LONGEST, 7)
    present = groups > 0
    present[:, 0] = True
    groups &= 127
    groups[:, :-1] |= present[:, 1:] * 128
    return groups[present].astype(np.uint8).tobytes()


def unpacked_signed(data: bytes, count: int) -> Numbers:
    """Decode exactly `count` numbers; raise InputError if the bytes are damaged."""
    groups = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(groups < 128)
    if len(ends) != count or (count and ends[-1] != len(groups) - 1) or (not count and data):
        raise InputError("the stream is damaged (its numbers)")
    numbers = np.empty(count, np.int64)
    start = 0
    for first in range(0, count, _PORTION):
        part = ends[first : first + _PORTION]
        numbers[first : first + _PORTION] = _numbers(groups[start : part[-1] + 1], part - start)
        start = int(part[-1]) + 1
    return numbers


def _numbers(groups: NDArray[np.uint8], ends: Numbers) -> Numbers:
    lengths = np.diff(ends, prepend=-1)
    if lengths.max(initial=0) > _LONGEST:
        raise InputError("the stream is damaged (its numbers)")
    zigzag = np.zeros(len(ends), np.int64)
    starts = ends - lengths + 1
    for place in range(int(lengths.max(initial=0))):
        rows = lengths > place
        zigzag[rows] |= (groups[starts[rows] + place].astype(np.int64) & 127) << 7 * place
    numbers: Numbers = (zigzag >> 1) ^ -(zigzag & 1)
    return numbers

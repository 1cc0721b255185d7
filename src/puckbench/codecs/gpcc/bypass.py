"""The chunked format that keeps bits coded without a model apart from the arithmetic-coded bytes.

A chunk has up to 256 bytes: the number of its arithmetic-coded bytes, these bytes, and from its
end backwards the bypass bits, of which the last byte says in three bits how many are padding.
"""

from __future__ import annotations

import numpy as np

from puckbench.codecs.gpcc.arithmetic import Bytes

_CHUNK = 256


def demultiplexed(data: Bytes) -> tuple[Bytes, Bytes]:
    """The arithmetic-coded bytes, and the bypass bits, one a byte."""
    coded, bits = [], []
    for start in range(0, len(data), _CHUNK):
        chunk = data[start : start + _CHUNK]
        split = 1 + int(chunk[0])
        coded.append(chunk[1:split])
        if split < len(chunk):
            bits.append(_bypass_bits(chunk[split:]))
    nothing = np.empty(0, dtype=np.uint8)
    return np.concatenate([nothing, *coded]), np.concatenate([nothing, *bits])


def _bypass_bits(stored: Bytes) -> Bytes:
    padding = int(stored[0]) & 7
    bits = np.unpackbits(stored[::-1])
    return bits[: max(len(bits) - 3 - padding, 0)]

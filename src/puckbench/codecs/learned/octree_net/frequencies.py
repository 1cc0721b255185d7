"""What a network says of symbols: integer frequencies from logits."""

from __future__ import annotations

from decimal import Decimal
from functools import cache

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.octree_net.fixed_point import UNITS

Logits = NDArray[np.float32]
Frequencies = NDArray[np.int32]
"""(n, 16)."""
_BITS = 16
_LEAST = 8


@cache
def powers() -> Frequencies:
    """2**16 times 2**(-d / UNITS), rounded, for d = 0, 1, .. until `_LEAST` is left."""
    steps = range((_BITS - 3) * UNITS + 1)
    exact = [Decimal(2) ** (_BITS - Decimal(d) / UNITS) for d in steps]
    return np.array([round(power) for power in exact], dtype=np.int32)


def frequencies(logits: Logits) -> Frequencies:
    """Frequencies of symbols from their logits (n, 16), to the base 2, multiples of 1 / UNITS.

    The likeliest symbol has 65,536 and no symbol less than 8.
    """
    units = logits * np.float32(UNITS)
    below = (units.max(axis=1, keepdims=True) - units).astype(np.int32)
    table = powers()
    np.minimum(below, len(table) - 1, out=below)
    return np.asarray(table[below])

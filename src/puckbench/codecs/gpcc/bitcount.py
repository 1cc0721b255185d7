"""The processor's count of set bits, for kernels."""

from __future__ import annotations

from typing import Any

from numba.extending import intrinsic


@intrinsic
def bit_count(_context: Any, word: Any) -> Any:
    """Number of set bits of an integer (in kernels only)."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return word(word), generate

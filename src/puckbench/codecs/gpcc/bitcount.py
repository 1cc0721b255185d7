"""The processor's count of set bits, for kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from puckbench.core.compiling import intrinsic


def _bit_count(_context: Any, word: Any) -> Any:
    """Number of set bits of an integer."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return word(word), generate


bit_count: Callable[[int], int] = intrinsic(_bit_count)
"""Number of set bits of an integer, in kernels only."""

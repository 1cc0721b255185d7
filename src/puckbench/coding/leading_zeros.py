"""Number of zero bits above a word's highest set bit, for compiled loops."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types

from puckbench.core.compiling import intrinsic


def _leading_zeros(typing: Any, word: Any) -> Any:
    """Typing and machine code: one instruction of the processor."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.ctlz(values[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.int64), code


leading_zeros: Any = intrinsic(_leading_zeros)
"""``leading_zeros(word)`` of a 64-bit integer; 64 for 0."""

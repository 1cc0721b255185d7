"""Copies and sums of short vectors, written in LLVM's vector instructions.

Numba cannot prove that arrays do not overlap and moves one number at a time, which takes two to
three times as long. Results are those of the loops.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types

from puckbench.core.compiling import intrinsic

_FLOAT_BYTES = 4
_FLOATS = 32
"""Of a vector at most; longer moves are several."""


def _mover(combine: Callable[[Any, Any, Any], Any]) -> Callable[..., Any]:
    """The typing of a move whose stored vector `combine` makes of builder, target and source."""

    def move(typing: Any, onto: Any, i: Any, source: Any, j: Any, width: Any) -> Any:
        if not isinstance(width, types.IntegerLiteral):
            return None

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            arrays = [context.make_array(signature.args[place])(context, builder, values[place])
                      for place in (0, 2)]  # fmt: skip
            for start in range(0, width.literal_value, _FLOATS):
                floats = min(_FLOATS, width.literal_value - start)
                kind, step = ir.VectorType(ir.FloatType(), floats), context.get_constant
                target, origin = (
                    builder.bitcast(
                        builder.gep(array.data, [builder.add(at, step(types.intp, start))]),
                        kind.as_pointer(),
                    )
                    for array, at in zip(arrays, (values[1], values[3]), strict=True)
                )
                made = combine(builder, target, builder.load(origin, align=_FLOAT_BYTES))
                builder.store(made, target, align=_FLOAT_BYTES)
            return context.get_dummy_value()

        return types.void(onto, types.intp, source, types.intp, width), code

    return move


def _copied(builder: Any, target: Any, read: Any) -> Any:
    return read


def _added(builder: Any, target: Any, read: Any) -> Any:
    return builder.fadd(builder.load(target, align=_FLOAT_BYTES), read)


copy_vector: Any = intrinsic(_mover(_copied), prefer_literal=True)
"""``copy_vector(onto, i, source, j, width)``: ``onto[i : i + width] = source[j : j + width]``,
unchecked, of flat float32 arrays."""
add_vector: Any = intrinsic(_mover(_added), prefer_literal=True)
"""``add_vector(onto, i, source, j, width)``: ``onto[i : i + width] += source[j : j + width]``,
likewise."""

"""Copying and adding short runs of floats as whole vectors, for compiled loops.

Compilers cannot prove that two arrays do not overlap, so a plain inner loop over a voxel's few
features moves one float at a time, ten times slower. Here the length is a constant of the compiled
code, and each run is one vector read and one vector written.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

from puckbench.core.compiling import intrinsic

_FLOAT_BYTES = 4


def _vector(context: Any, builder: Any, kind: Any, array: Any, at: Any, length: int) -> Any:
    """Address of element `at` of a flat float32 array, as that of a vector."""
    data = context.make_array(kind)(context, builder, array).data
    vector = ir.VectorType(ir.FloatType(), length)
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())


def _run(length: Any, onto: Any, source: Any, adds: bool) -> Any:
    """Signature and code of ``onto[i : i + length] (+)= source[j : j + length]``."""
    if not isinstance(length, types.IntegerLiteral):
        return None
    floats = length.literal_value

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kinds = signature.args
        target = _vector(context, builder, kinds[0], values[0], values[1], floats)
        origin = _vector(context, builder, kinds[2], values[2], values[3], floats)
        value = builder.load(origin, align=_FLOAT_BYTES)
        if adds:
            value = builder.fadd(builder.load(target, align=_FLOAT_BYTES), value)
        builder.store(value, target, align=_FLOAT_BYTES)
        return context.get_dummy_value()

    return types.void(onto, types.intp, source, types.intp, length), code


def _copy_run(typing: Any, onto: Any, i: Any, source: Any, j: Any, length: Any) -> Any:
    return _run(length, onto, source, adds=False)


def _add_run(typing: Any, onto: Any, i: Any, source: Any, j: Any, length: Any) -> Any:
    return _run(length, onto, source, adds=True)


copy_run: Any = intrinsic(_copy_run, prefer_literal=True)
"""``copy_run(onto, i, source, j, n)``: ``onto[i : i + n] = source[j : j + n]``, unchecked."""

add_run: Any = intrinsic(_add_run, prefer_literal=True)
"""``add_run(onto, i, source, j, n)``: ``onto[i : i + n] += source[j : j + n]``, unchecked."""

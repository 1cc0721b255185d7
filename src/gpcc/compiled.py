from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pointkit import compiling

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
_KERNEL: dict[str, Any] = {**_OPTIONS, **compiling.IN_PLACE}
# Most functions compile faster than their wrapper for calls from Python.
_INTERNAL = {**_KERNEL, "no_cpython_wrapper": True}

integer = cast(Callable[[Any], int], np.int64)
"""Convert a narrower integer or a truth value to a 64-bit integer.

Numba would convert mixed signed and unsigned integers to floats.
"""

unsigned = cast(Callable[[Any], int], np.uint64)
"""Convert an index that is not negative, to save Numba's check for negative ones in short loops."""


def compiled(function: Function) -> Function:
    """Compile a function that may create arrays, and cache the machine code."""
    return compiling.compiled(function, **_OPTIONS)


def entry(function: Function) -> Function:
    """Compile a function that creates no arrays and is called from Python."""
    return compiling.compiled(function, **_KERNEL)


def kernel(function: Function) -> Function:
    """Compile a function that only compiled functions call."""
    return compiling.compiled(function, **_INTERNAL)


def part(function: Function) -> Function:
    """Compile a function so that it is inlined in the only function that calls it."""
    return compiling.compiled(function, inline="always", **_INTERNAL)


@compiling.inlined
def row(rows: NDArray[Any], i: int) -> tuple[int, int, int]:
    """Return the first three integers of row `i` of an array as 64-bit integers."""
    return integer(rows[i, 0]), integer(rows[i, 1]), integer(rows[i, 2])

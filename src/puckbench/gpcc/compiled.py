"""How the kernels of G-PCC are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np

from puckbench.core import compiling

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
_KERNEL: dict[str, Any] = {**_OPTIONS, **compiling.IN_PLACE}
# What lets Python call a function takes longer to compile than most functions.
_INTERNAL = {**_KERNEL, "no_cpython_wrapper": True}

integer = cast(Callable[[Any], int], np.int64)
"""Makes a 64-bit integer of a narrower one or of a truth value; in kernels, wherever a number is
not certain to be one already, since unsigned and signed numbers together would become floats."""


def compiled(function: Function) -> Function:
    """Compile a function that makes arrays, on its first call; later processes load it."""
    return compiling.compiled(function, **_OPTIONS)


def entry(function: Function) -> Function:
    """Compile a kernel that Python calls: it makes no array, but works on those it is given."""
    return compiling.compiled(function, **_KERNEL)


def kernel(function: Function) -> Function:
    """Compile a kernel that only others call."""
    return compiling.compiled(function, **_INTERNAL)


def part(function: Function) -> Function:
    """Make a kernel part of the one that calls it: for one that is called at a single place."""
    return compiling.compiled(function, inline="always", **_INTERNAL)

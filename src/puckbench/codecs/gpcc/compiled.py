"""How the kernels are compiled.

The cache on disk looks at the file of a kernel alone: after a change to one that another file's
kernels call, remove the package's __pycache__.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = numba.njit
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
# Kernels own no arrays; counting references to those that they are given took half of their time.
_BORROWING = {**_OPTIONS, "_nrt": False}
# What lets Python call a function takes longer to compile than most functions.
_INTERNAL = {**_BORROWING, "no_cpython_wrapper": True}
INLINED: Any = {**_INTERNAL, "forceinline": True}

integer = cast(Callable[[Any], int], np.int64)
"""Makes a 64-bit integer of a narrower one or of a truth value; in kernels, wherever a number is
not certain to be one already, since unsigned and signed numbers together would become floats."""


def compiled(function: Function) -> Function:
    """Compile a function that makes arrays, on its first call; later processes load it."""
    return cast(Function, _njit(cache=True, **_OPTIONS)(function))


def entry(function: Function) -> Function:
    """Compile a kernel that Python calls: it makes no array, but works on those it is given."""
    return cast(Function, _njit(cache=True, **_BORROWING)(function))


def kernel(function: Function) -> Function:
    """Compile a kernel that only others call."""
    return cast(Function, _njit(cache=True, **_INTERNAL)(function))


def inlined(function: Function) -> Function:
    """Compile a kernel into those that call it."""
    return cast(Function, _njit(cache=True, **INLINED)(function))

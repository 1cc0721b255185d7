"""How the kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = numba.njit
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
# Kernels own no arrays; counting references to those that they are given took half of their time.
BORROWING = {**_OPTIONS, "_nrt": False}
INLINED: Any = {**BORROWING, "forceinline": True}

integer = cast(Callable[[Any], int], np.int64)
"""Makes a 64-bit integer of a narrower one or of a truth value; in kernels, wherever a number is
not certain to be one already, since unsigned and signed numbers together would become floats."""


def compiled(function: Function) -> Function:
    """Compile a function that makes arrays, on its first call; later processes load it."""
    return cast(Function, _njit(cache=True, **_OPTIONS)(function))


def kernel(function: Function) -> Function:
    """Compile a function that makes no array but works on those that it is given."""
    return cast(Function, _njit(cache=True, **BORROWING)(function))


def inlined(function: Function) -> Function:
    """Compile a kernel into those that call it."""
    return cast(Function, _njit(cache=True, **INLINED)(function))

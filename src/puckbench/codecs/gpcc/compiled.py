"""How the kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS = {"nogil": True, "error_model": "numpy"}
# Kernels own no arrays; counting references to those that they are given took half of their time.
BORROWING = {**_OPTIONS, "_nrt": False}
INLINED = {**BORROWING, "forceinline": True}


def compiled(function: Function) -> Function:
    """Compile a function that makes arrays, on its first call; later processes load it."""
    return cast(Function, numba.njit(cache=True, **_OPTIONS)(function))


def kernel(function: Function) -> Function:
    """Compile a function that makes no array but works on those that it is given."""
    return cast(Function, numba.njit(cache=True, **BORROWING)(function))


def inlined(function: Function) -> Function:
    """Compile a kernel into those that call it."""
    return cast(Function, numba.njit(cache=True, **INLINED)(function))

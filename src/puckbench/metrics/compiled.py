"""Machine code for loops over points: numba's compiler, cached on disk, with the types kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile `function` on its first call; later processes load it from the cache.

    Strict IEEE arithmetic (no fused or reordered operations), so that equal distances stay equal.
    """
    return cast(Function, numba.njit(cache=True)(function))

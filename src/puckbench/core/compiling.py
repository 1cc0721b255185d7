"""Machine code for loops: numba's compiler, cached on disk for each state of a package's sources.

Numba's own cache looks at the file of a function alone, and would go on using machine code in which
an older version of another file's function is compiled.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

IN_PLACE: dict[str, Any] = {"_nrt": False}
"""Numba's options for a function that makes no arrays and calls none that does: references to those
that it is given are not counted. Where small functions hand records of arrays to each other, as
coders of single bits do, counting takes three times as long as their work."""

_config: Any = numba.config  # its entries come from the environment


def _start_without_blas() -> None:
    """Load numba's library without its look for SciPy's BLAS: a sixth of a second of every process.

    It looks again when it compiles a function that calls BLAS.
    """
    from numba.np import linalg

    look: Any = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = look


_start_without_blas()


def compiled(function: Function, **options: Any) -> Function:
    """Compile `function` on its first call; later processes load it from the cache.

    The cache holds while no file changes in the folder of the function's file and in the one above,
    which is therefore where all that it calls must be. Arithmetic is strict IEEE (no fused or
    reordered operations) unless numba's `options` say otherwise: equal distances stay equal. Other
    threads run meanwhile.
    """
    folder = Path(function.__code__.co_filename).parent
    chosen = _config.CACHE_DIR
    _config.CACHE_DIR = str(Path(chosen or folder / "__pycache__") / _state_of(folder))
    try:
        return cast(Function, numba.njit(cache=True, nogil=True, **options)(function))
    finally:
        _config.CACHE_DIR = chosen


def compiled_in_place(function: Function, **options: Any) -> Function:
    """Compile a function that makes no arrays (`IN_PLACE`), as `compiled` does."""
    return compiled(function, **IN_PLACE, **options)


@cache
def _state_of(folder: Path) -> str:
    digest = hashlib.sha256()
    for file in (*sorted(folder.glob("*.py")), *sorted(folder.parent.glob("*.py"))):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return f"numba-{digest.hexdigest()[:12]}"

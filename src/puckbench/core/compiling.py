"""The one door for compiled loops: numba's compiler, cached on disk as long as no source changes.

Numba's own cache looks at the file of a function alone, and would go on using machine code in which
an older version of another file's function or constant is compiled. Here the place of the cache is
named after the contents of the function's file and of all that it imports.

With ``NUMBA_BOUNDSCHECK=1`` in the environment every index of every compiled loop is checked: one
outside its array raises IndexError. Such machine code, some three times slower, has its own cache.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import extending
from numba.core.caching import InTreeCacheLocator
from numba.core.event import Event, Listener, register

from puckbench.core.imports import reached_files
from puckbench.core.loop_cache import loops_folder

Function = TypeVar("Function", bound=Callable[..., Any])

IN_PLACE: dict[str, Any] = {"_nrt": False}
"""Numba's options for a function that makes no arrays and calls none that does: references to those
that it is given are not counted. Where small functions hand records of arrays to each other, as
coders of single bits do, counting takes three times as long as their work."""

INLINED: Any = {
    **IN_PLACE,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
    "forceinline": True,
}
"""Numba's options for a function that only other compiled functions call, and become one with."""

_SECONDS_UNTIL_NOTICE = 3.0
_COMPILING = "compiling loops for this machine, once: this takes up to two minutes"
_config: Any = numba.config
_LOCATORS = f"{__name__}.SourcesLocator,IPythonCacheLocator"
"""Numba's setting for the place of caches: those of files, and those of cells of a notebook."""


class SourcesLocator(InTreeCacheLocator):
    """Names the folder of a function's machine code after the state of its sources.

    Numba's setting ``CACHE_LOCATOR_CLASSES`` names such classes. It holds for a process: functions
    of a user's codec that numba compiles later are kept in the same way.
    """

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        super().__init__(py_func, py_file)  # type: ignore[no-untyped-call]
        file = Path(py_file).absolute()
        place = state_of(file) + ("-checked" if _config.BOUNDSCHECK else "")
        self._folder = loops_folder(file.parent) / place

    def get_cache_path(self) -> str:
        """Folder of the function's compiled code."""
        return str(self._folder)


class CompilingNotice(Listener):
    """Says once, on standard error, that loops are being compiled, when that takes a while.

    Loops from the cache are not compiled, and raise no event.
    """

    def __init__(self) -> None:
        self._depth, self._seconds, self._began = 0, 0.0, 0.0
        self.told = False

    def on_start(self, event: Event) -> None:
        """A loop begins to be compiled, perhaps within another one."""
        now = time.monotonic()
        self._began = self._began if self._depth else now
        self._depth += 1
        spent = self._seconds + now - self._began
        if spent > _SECONDS_UNTIL_NOTICE and not self.told:
            self.told = True
            print(_COMPILING, file=sys.stderr, flush=True)  # noqa: T201

    def on_end(self, event: Event) -> None:
        """It is compiled."""
        self._depth -= 1
        if not self._depth:
            self._seconds += time.monotonic() - self._began


_register: Any = register  # numba has no type hints here
NOTICE = CompilingNotice()
_register("numba:compile", NOTICE)


def compiled(function: Function, **options: Any) -> Function:
    """Compile `function` on its first call; later processes load it from the cache.

    The cache holds while neither the file of the function changes nor one that it imports
    (`puckbench.core.imports`). Arithmetic is strict IEEE (no fused or
    reordered operations) unless numba's `options` say otherwise: equal distances stay equal. Other
    threads run meanwhile.
    """
    _config.CACHE_LOCATOR_CLASSES = _LOCATORS
    return cast(Function, numba.njit(cache=True, nogil=True, **options)(function))


def compiled_in_place(function: Function, **options: Any) -> Function:
    """Compile a function that makes no arrays (`IN_PLACE`), as `compiled` does."""
    return compiled(function, **IN_PLACE, **options)


def inlined(function: Function) -> Function:
    """Compile a function that makes no arrays into the compiled functions that call it."""
    return compiled(function, **INLINED)


def inlined_too(function: Function) -> Function:
    """Compile a function that makes no arrays, also into the compiled functions that call it."""
    return compiled_in_place(function, forceinline=True)


def intrinsic(function: Callable[..., Any], **options: Any) -> Any:
    """A function of compiled loops whose machine code `function` writes (`numba.extending`)."""
    written: Any = extending.intrinsic(**options) if options else extending.intrinsic
    return written(function)


@cache
def state_of(file: Path) -> str:
    """Name for the contents of a source file and of all that it imports, directly or not."""
    digest = hashlib.sha256()
    for source in sorted(reached_files(file), key=lambda path: path.as_posix()):
        digest.update(source.name.encode() + b"\0" + _content_digest(source))
    return f"numba-{digest.hexdigest()[:12]}"


@cache
def _content_digest(file: Path) -> bytes:
    content = file.read_bytes() if file.is_file() else b""  # a notebook's cell has none
    return hashlib.sha256(content).digest()

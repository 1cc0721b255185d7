"""Functions compiled by numba, and cached on disk until one of their source files changes.

Numba's cache checks only a function's own file, and may reuse machine code that contains outdated
functions of other files. Here a digest of the sources of the function's package and of pointkit
names the cache folder: a compiled function calls compiled functions of these two alone.

With ``NUMBA_BOUNDSCHECK=1``, indices outside arrays raise IndexError in compiled loops, which are
then three times slower and cached separately.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import extending
from numba.core.caching import InTreeCacheLocator
from numba.core.event import Event, Listener, register

from pointkit.sources import loops_folder, package_folder, sources_digest

Function = TypeVar("Function", bound=Callable[..., Any])

IN_PLACE: dict[str, Any] = {"_nrt": False}
"""Options without reference counting, for functions that neither make arrays nor call functions
that do. In small functions that pass arrays to each other, such as arithmetic coders, counting
takes three times as long as all other work."""

INLINED: Any = {
    **IN_PLACE,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
    "forceinline": True,
}
"""Options for functions that are compiled only as parts of compiled callers."""

_SECONDS_UNTIL_NOTICE = 3.0
_COMPILING = "compiling loops for this machine, once: this takes up to two minutes"
_config: Any = numba.config
_LOCATORS = f"{__name__}.SourcesLocator,IPythonCacheLocator"


class SourcesLocator(InTreeCacheLocator):
    """Gives numba a cache folder for each function that depends on the function's source files."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        super().__init__(py_func, py_file)  # type: ignore[no-untyped-call]
        file = Path(py_file).absolute()
        place = state_of(file) + ("-checked" if _config.BOUNDSCHECK else "")
        self._folder = loops_folder(file.parent) / place

    def get_cache_path(self) -> str:
        """Return the cache folder for the present content of the source files."""
        return str(self._folder)


class CompilingNotice(Listener):
    """Prints one notice on standard error if compilation takes long."""

    def __init__(self) -> None:
        self._depth, self._seconds, self._began = 0, 0.0, 0.0
        self.is_printed = False

    def on_start(self, event: Event) -> None:
        """Start the timer, and print the notice if compilation has already taken long."""
        now = time.monotonic()
        self._began = self._began if self._depth else now
        self._depth += 1
        spent = self._seconds + now - self._began
        if spent > _SECONDS_UNTIL_NOTICE and not self.is_printed:
            self.is_printed = True
            print(_COMPILING, file=sys.stderr, flush=True)  # noqa: T201

    def on_end(self, event: Event) -> None:
        """Add the duration of a finished compilation."""
        self._depth -= 1
        if not self._depth:
            self._seconds += time.monotonic() - self._began


_FUNCTIONS: dict[str, Any] = {}
"""Compiled functions of this process by name; not those that are made in other functions."""
_register: Any = register  # numba has no type hints here
NOTICE = CompilingNotice()
_register("numba:compile", NOTICE)


def compiled(function: Function, **options: Any) -> Function:
    """Compile a function with Numba on its first call, or load its machine code from a cache.

    This is a decorator. The cache is used only while no source file of the function's package, or
    of pointkit, has changed. Arithmetic is strict IEEE 754, and compiled code releases Python's
    global interpreter lock.

    Parameters
    ----------
    function
        Function to compile.
    **options
        Options of ``numba.njit``.

    Returns
    -------
    callable
        The compiled function.
    """
    _config.CACHE_LOCATOR_CLASSES = _LOCATORS
    result = cast(Function, numba.njit(cache=True, nogil=True, **options)(function))
    if "<locals>" not in function.__qualname__ and not _config.DISABLE_JIT:
        _FUNCTIONS[f"{function.__module__}.{function.__qualname__}"] = result
    return result


def compiled_in_place(function: Function, **options: Any) -> Function:
    """Compile a function that creates no arrays and calls no functions that do.

    The compiled function does not count references, which would cost small functions more time than
    their work.
    """
    return compiled(function, **IN_PLACE, **options)


def inlined(function: Function) -> Function:
    """Compile a function only as a part of compiled functions that call it.

    Python cannot call the function. It must create no arrays.
    """
    return compiled(function, **INLINED)


def inlined_too(function: Function) -> Function:
    """Compile a function that Python can call and that also becomes part of compiled callers.

    The function must create no arrays.
    """
    return compiled_in_place(function, forceinline=True)


def loaded_functions() -> dict[str, list[Any]]:
    """Return the argument types of functions whose machine code this process has read from caches.

    The result is by name of the function. It is empty if this process has compiled a function,
    because then it also has functions that later processes do not need.
    """
    if any(function.stats.cache_misses for function in _FUNCTIONS.values()):
        return {}
    return {name: each.signatures for name, each in _FUNCTIONS.items() if each.signatures}


def load_functions(argument_types: Mapping[str, list[Any]]) -> None:
    """Read the machine code of functions from caches, as another process has done.

    Parameters
    ----------
    argument_types
        What `loaded_functions` returned in the other process. Functions of modules that this
        process has not imported are left out.
    """
    for name in argument_types.keys() & _FUNCTIONS.keys():
        for types in argument_types[name]:
            _FUNCTIONS[name].compile(types)


def intrinsic(function: Callable[..., Any], **options: Any) -> Any:
    """Return an intrinsic of numba: `function` generates its LLVM code (see `numba.extending`)."""
    written: Any = extending.intrinsic(**options) if options else extending.intrinsic
    return written(function)


def state_of(file: Path) -> str:
    """Return a digest of all source files that the compiled functions of a file may depend on."""
    folders = [package_folder(file), Path(__file__).parent]
    digest = hashlib.sha256(b"".join(map(sources_digest, folders)))
    return f"numba-{digest.hexdigest()[:12]}"

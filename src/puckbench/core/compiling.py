"""The one door for compiled loops: numba's compiler, cached on disk as long as no source changes.

Numba's own cache looks at the file of a function alone, and would go on using machine code in which
an older version of another file's function or constant is compiled. Here the place of the cache is
named after the contents of the function's file and of all that it imports.

With ``NUMBA_BOUNDSCHECK=1`` in the environment every index of every compiled loop is checked: one
outside its array raises IndexError. Such machine code, some three times slower, has its own cache.
"""

from __future__ import annotations

import hashlib
import importlib
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import extending
from numba.core.event import Event, Listener, register

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
_PACKAGE = Path(__file__).parents[1]
_config: Any = numba.config  # its entries come from the environment
_PLACING = threading.Lock()
"""Held while numba looks for a function's cache, whose place is a setting for all threads."""


def _start_without_blas() -> None:
    """Import numba without its search for SciPy's BLAS, a sixth of a second of every process.

    Numba searches again when it compiles a function that calls BLAS.
    """
    from numba.np import linalg

    search: Any = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = search


_start_without_blas()


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

    The cache holds while no file changes of the function's module and of the modules of its package
    and of puckbench that it imports, directly or not. Arithmetic is strict IEEE (no fused or
    reordered operations) unless numba's `options` say otherwise: equal distances stay equal. Other
    threads run meanwhile.
    """
    file = Path(function.__code__.co_filename)
    place = state_of(file) + ("-checked" if _config.BOUNDSCHECK else "")
    with _PLACING:
        chosen = _config.CACHE_DIR
        _config.CACHE_DIR = str((Path(chosen) if chosen else loops_folder(file.parent)) / place)
        try:
            return cast(Function, numba.njit(cache=True, nogil=True, **options)(function))
        finally:
            _config.CACHE_DIR = chosen


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
    for source in sorted(_reached(file)):
        digest.update(source.name.encode() + b"\0" + _read(source)[0])
    return f"numba-{digest.hexdigest()[:12]}"


def _reached(file: Path) -> set[Path]:
    found: set[Path] = set()
    waiting = [file]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting += _read(source)[1]
    return found


_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(\.*)([\w.]*)[ \t]+)?import[ \t]+(\([^)]*\)|[^\n]*)", re.MULTILINE
)


_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:(?:[ \t]+[^\n]*)?\n)*", re.MULTILINE)


@cache
def _read(source: Path) -> tuple[bytes, set[Path]]:
    """Digest of a file, and the files that it imports, when it runs, of those that are followed."""
    content = source.read_bytes() if source.is_file() else b""  # a notebook's cell has none
    statements = set(_IMPORT.findall(_FOR_TYPES.sub("", content.decode(errors="replace"))))
    imported = {file for each in statements for file in _imported(source, *each)}
    return hashlib.sha256(content).digest(), imported


def _imported(source: Path, dots: str, module: str, names: str) -> Iterator[Path]:
    """Files of the module and, where it is a package, of its modules that a statement imports."""
    if dots:
        package = source.relative_to(_top(source)).parts[: -len(dots)]
        module = ".".join((*package, *filter(None, [module])))
    inner = re.findall(r"[\w.]+", names)
    for each in [module] if module else inner:
        root = _root(source, each.partition(".")[0])
        file = _file(root, each) if root else None
        if file is not None:
            yield file
            if module and file.name == "__init__.py":
                inside = (_file(root, f"{module}.{name}") for name in inner)
                yield from filter(None, inside)


@cache
def _top(source: Path) -> Path:
    """The folder that a file's outermost package lies in; without a package, its own folder."""
    folder = source.parent
    while (folder / "__init__.py").exists():
        folder = folder.parent
    return folder


@cache
def _root(source: Path, package: str) -> Path | None:
    """Where a package that a file imports is looked for; None when its changes do not count."""
    if package == _PACKAGE.name:
        return _PACKAGE.parent
    top = _top(source)
    is_own = top == source.parent or source.relative_to(top).parts[0] == package
    return top if is_own else None


@cache
def _file(root: Path | None, module: str) -> Path | None:
    """A module's source file, if it has one."""
    if root is None:
        return None
    base = root / module.replace(".", "/")
    files = (base.with_name(f"{base.name}.py"), base / "__init__.py")
    return next((file for file in files if file.is_file()), None)

"""Plug-ins by name: the one way to add a codec, a data set, an error model, a table or a figure.

A plug-in is one file with one class or function and, above it, its registration::

    @CODECS.register("grid")
    class Grid(Codec): ...

Ours are found by reading the sources of their room, without importing them; those of other
installed packages by entry points of the group ``puckbench.<kind>s``; a user's own by the place of
its file, ``path/to/file.py:Name``. Only the plug-in that is asked for is imported.

A place is code that runs, so it comes from the command line, from a configuration that the user
gives or from a program, which hand it to `trust`. Streams, tables, results and other data may name
registered plug-ins alone: `load`, by which every place is loaded, refuses all that are not trusted.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeGuard, TypeVar

from puckbench.core.errors import InputError
from puckbench.core.imports import reached_files, top_folder
from puckbench.core.models import among

T = TypeVar("T")
Registered = TypeVar("Registered")

_SOURCES = Path(__file__).parents[1]
_trusted: set[str] = set()
"""Places that `load` may import from in this process."""


def trust(names: Iterable[str | None]) -> None:
    """Allow this process to load code from those of the names that are places.

    Parameters
    ----------
    names
        What the command line, a configuration that the user gives, or a program names as plug-ins:
        never what a file of data holds.
    """
    _trusted.update(name for name in names if is_place(name))


def is_place(name: object) -> TypeGuard[str]:
    """Whether it is ``module:Name`` or ``path/to/file.py:Name``, not the name of a plug-in."""
    return isinstance(name, str) and ":" in name


class Registry(Generic[T]):
    """The plug-ins of one kind.

    Parameters
    ----------
    kind
        What a plug-in is called in messages ("error model"); the registry's variable is this word
        in capitals and the plural (``ERROR_MODELS``).
    rooms
        Folders of puckbench's sources, relative to its root, in which ours are registered.
    make
        What a registration makes of the class or function and of the further arguments of
        `register`; without it the class or function itself is the plug-in.
    """

    def __init__(self, kind: str, *rooms: str, make: Callable[..., T] | None = None) -> None:
        self.kind = kind
        self._variable = f"{kind.upper().replace(' ', '_')}S"
        self._rooms = rooms
        self._make = make
        self._loaded: dict[str, T] = {}
        self._added: dict[str, str] = {}
        self._of_target: dict[int, T] = {}

    def register(self, name: str, **about: Any) -> Callable[[Registered], Registered]:
        """Register the class or function below under a name."""

        def registered(target: Registered) -> Registered:
            plugin: Any = target if self._make is None else self._make(name, target, **about)
            self._loaded[name] = self._of_target[id(target)] = plugin
            return target

        return registered

    @property
    def group(self) -> str:
        """Entry points of installed packages: name to ``module:Name``."""
        return f"puckbench.{self._variable.lower()}"

    @cached_property
    def _ours(self) -> dict[str, str]:
        """Name -> dotted module, in the order of the sources."""
        marker = re.compile(rf'^@{self._variable}\.register\(\s*"([^"]+)"', re.MULTILINE)
        found: dict[str, str] = {}
        for path in self._sources():
            for name in marker.findall(path.read_text(encoding="utf-8")):
                found[name] = ".".join(
                    ("puckbench", *path.relative_to(_SOURCES).with_suffix("").parts)
                )
        return found

    def _sources(self) -> Iterator[Path]:
        for room in self._rooms:
            yield from sorted((_SOURCES / room).rglob("*.py"))

    def add(self, place: str) -> None:
        """List a plug-in of ``module:Name`` or ``path/to/file.py:Name`` beside ours, as ``Name``.

        Raises
        ------
        InputError
            One of ours has that name, or the place is not of that form, or not trusted.
        """
        module, _, name = place.rpartition(":")
        if not module or self._added.get(name, place) != place or name in self._ours:
            fault = "that name is taken" if module else "must be module:Name or file.py:Name"
            raise InputError(f"{self.kind} {place}: {fault}")
        _check_trusted(place, self.kind)
        self._added[name] = place

    @cached_property
    def _installed(self) -> dict[str, str]:
        places = {point.name: point.value for point in entry_points(group=self.group)}
        trust(places.values())
        return places

    def names(self) -> list[str]:
        """Names of ours, of installed packages' plug-ins, and of those added."""
        return list({**self._ours, **self._installed, **self._added})

    def module_of(self, name: str) -> str:
        """The module (or file) that a plug-in is defined in, for the fingerprint of its code."""
        return self._ours[name] if name in self._ours else self._place(name).rpartition(":")[0]

    def place_of(self, name: str) -> str:
        """What `get` finds a plug-in by in another process: an added one's place, else its name."""
        return self._added.get(name, name)

    def get(self, name: str) -> T:
        """The plug-in of a name, or of a place that is trusted.

        Raises
        ------
        InputError
            There is none, the place is not trusted, or it cannot be loaded.
        """
        if name in self._ours:
            importlib.import_module(self._ours[name])
            return self._loaded[name]
        return self._from_place(name, self._place(name))

    def name_of(self, plugin: T) -> str:
        """The name that a loaded plug-in was registered under."""
        return next(name for name, one in self._loaded.items() if one is plugin)

    def __contains__(self, name: str) -> bool:
        # In this order: a look at the installed packages takes time, and mostly it is one of ours.
        return name in self._ours or name in self._added or name in self._installed

    def _place(self, name: str) -> str:
        place = self._added.get(name) or self._installed.get(name, name)
        if ":" not in place:
            raise InputError(f"unknown {self.kind} '{name}'{among(name, self.names())}")
        _check_trusted(place, self.kind)
        return place

    def _from_place(self, name: str, place: str) -> T:
        target: Any = load(place, f"{self.kind} {name}")
        if id(target) in self._of_target:
            return self._of_target[id(target)]
        return target if self._make is None else self._make(name, target)


def load(place: str, what: str) -> Any:
    """The object at ``module:Name`` or ``path/to/file.py:Name``; `what` it is for begins errors.

    Raises
    ------
    InputError
        It is not of that form, is not trusted, or cannot be loaded.
    """
    module_name, _, name = place.rpartition(":")
    if not module_name:
        raise InputError(f"{what}: '{place}' is not of the form module:Name or file.py:Name")
    _check_trusted(place, what)
    try:
        return getattr(_module(module_name), name)
    except (ImportError, OSError, AttributeError, SyntaxError) as error:
        raise InputError(f"{what}: cannot load '{place}' ({error})") from error


def _check_trusted(place: str, what: str) -> None:
    if place not in _trusted:
        raise InputError(
            f"{what}: {place!r} is code, which is not loaded: neither the command line nor the "
            "configuration names it"
        )


def _module(name: str) -> ModuleType:
    if not name.endswith(".py"):
        return importlib.import_module(name)
    path = Path(name).resolve()
    top = top_folder(path)
    if str(top) not in sys.path:
        sys.path.append(str(top))  # also for what it imports later, when it codes
    _check_visible(path, top)
    if top != path.parent:
        return importlib.import_module(".".join(path.relative_to(top).with_suffix("").parts))
    # A name of its own, since data classes and pickle look for the module of a class by its name.
    own = f"{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if own in sys.modules:
        return sys.modules[own]
    spec = importlib.util.spec_from_file_location(own, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{name} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[own] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[own]
        raise
    return module


def _check_visible(path: Path, top: Path) -> None:
    """ImportError where a file would import another module of the name of one beside it."""
    beside = {file for file in reached_files(path) - {path} if top_folder(file) == top}
    for file in sorted(beside):
        name = file.relative_to(top).parts[0].removesuffix(".py")
        spec = importlib.util.find_spec(name)
        if spec and spec.origin and not Path(spec.origin).is_relative_to(top):
            raise ImportError(f"{file} is hidden by {spec.origin}: rename it")

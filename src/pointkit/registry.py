"""Plug-ins that are found by name: codecs, scene sets, error models, tables, figures and others.

A plug-in is one file with one class or function, registered where it is defined::

    @CODECS.register("grid")
    class Grid(Codec): ...

A package's plug-ins of a kind are in ``package/<folder>/``, ``package/*/<folder>/`` or the module
``package/<folder>.py``. A registry lists the plug-ins of its own package, and of all packages that
declare the entry point ``NAME = "package"`` in the group ``puckbench.plugins``. To list them, it
imports all modules in these places; such modules should therefore import heavy packages inside
functions only. To find the plug-in ``a_b``, it first imports the module ``a_b`` or, if this is
missing, ``a``. A package may also declare single plug-ins as entry points in the group
``puckbench.<kind>s``.

A *place*, ``module:Name`` or ``path/to/file.py:Name``, refers to a class or function of the user.
Since loading a place runs code, `load` accepts only places that were passed to `trust`: those that
are named on the command line or in a configuration, never those in streams, tables or other data.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import pkgutil
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import chdir
from functools import cache, cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeGuard, TypeVar

from pointkit.errors import InputError, among, error_text
from pointkit.sources import import_folder

T = TypeVar("T")
Target = TypeVar("Target")

_PLUGINS = "puckbench.plugins"
"""Group of the entry points of packages that add plug-ins of several kinds."""
_trusted: set[str] = set()


def trust(names: Iterable[str | None]) -> None:
    """Allow `load` to import the given places; names that are no places are ignored."""
    _trusted.update(name for name in names if is_place(name))


def trusted_files() -> set[Path]:
    """Return the absolute paths of the Python files that trusted places name."""
    files = (place.rpartition(":")[0] for place in _trusted)
    return {Path(file).absolute() for file in files if file.endswith(".py")}


def is_place(name: object) -> TypeGuard[str]:
    """Return whether a name is a place: ``module:Name`` or ``file.py:Name``."""
    return isinstance(name, str) and ":" in name


class Registry(Generic[T]):
    """Finds plug-ins of one kind, such as all codecs, by name.

    Parameters
    ----------
    kind
        What a plug-in is called in messages, in the singular (such as "error model").
    folder
        Name of the folders whose modules register plug-ins (such as "figures").
    package
        The package to which the registry belongs.
    make
        Function that creates a plug-in from its name, its class or function, and the keyword
        arguments of `register`. By default, the class or function itself is the plug-in.
    """

    def __init__(
        self,
        kind: str,
        folder: str,
        package: str = "puckbench",
        make: Callable[..., T] | None = None,
    ) -> None:
        self.kind = kind
        self._folders = (folder, package)
        self._make = make
        self._plugins: dict[tuple[str, str], T] = {}
        """Plug-ins by module and registered name."""
        self._targets: dict[tuple[str, str], Any] = {}
        self._modules: dict[str, str] = {}
        """Modules of the imported plug-ins of packages, by name of the plug-in."""
        self._added: dict[str, str] = {}

    def register(self, name: str, **details: Any) -> Callable[[Target], Target]:
        """Return a decorator that registers a class or function as a plug-in.

        Parameters
        ----------
        name
            Name of the plug-in.
        **details
            Further arguments of the registry's function `make`.
        """

        def registered(target: Target) -> Target:
            module = target.__module__
            if module.partition(".")[0] in _packages(self._folders[1]):
                self._modules.setdefault(name, module)
            if self._modules.get(name, module) != module:
                fault = f"{module} registers the name of {self._modules[name]}: rename it"
                raise InputError(f"{self.kind} {name}: {fault}")
            self._targets[module, name] = target
            self._plugins[module, name] = self._made(name, target, **details)
            return target

        return registered

    @property
    def group(self) -> str:
        """Name of the entry-point group in which packages declare single plug-ins of this kind."""
        return f"puckbench.{self.kind.replace(' ', '_')}s"

    @cached_property
    def _ours(self) -> list[str]:
        for module in _modules(*self._folders):
            importlib.import_module(module)
        return sorted(self._modules, key=lambda name: self._modules[name])

    def _is_ours(self, name: str) -> bool:
        if name not in self._modules and not is_place(name):
            self._import_nearest(name)
            return name in self._modules or name in self._ours
        return name in self._modules

    def _import_nearest(self, name: str) -> None:
        modules = {module.rpartition(".")[2]: module for module in _modules(*self._folders)}
        beginnings = [stem for stem in modules if f"{name}_".startswith(f"{stem}_")]
        if beginnings:
            importlib.import_module(modules[max(beginnings, key=len)])

    def add(self, place: str) -> None:
        """Add the plug-in at a trusted place ``module:Name``; its name is the part after the colon.

        Raises InputError if another plug-in already has this name.
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
        """Return the names of all plug-ins: the package's own, installed ones, and added ones."""
        return list(dict.fromkeys([*self._ours, *self._installed, *self._added]))

    def module_of(self, name: str) -> str:
        """Return the module or file that defines a plug-in."""
        return self._modules[name] if self._is_ours(name) else self._place(name).rpartition(":")[0]

    def place_of(self, name: str) -> str:
        """Return the name or ``module:Name`` by which another process can load a plug-in."""
        return self._added.get(name, name)

    def get(self, name: str) -> T:
        """Return the plug-in with this name or at this place (``module:Name`` or ``file.py:Name``).

        Raises InputError if there is no such plug-in, or the place is not trusted (`trust`).
        """
        if self._is_ours(name):
            return self._plugins[self._modules[name], name]
        target = load(self._place(name), f"{self.kind} {name}")
        for key, registered in self._targets.items():
            if registered is target:
                return self._plugins[key]
        plugin: T = self._made(name, target)
        return plugin

    def name_of(self, plugin: T) -> str:
        """Return the name under which a plug-in is registered."""
        return next(name for (_, name), each in self._plugins.items() if each is plugin)

    def __contains__(self, name: str) -> bool:
        # A search of the installed packages is slow, so it comes last.
        return self._is_ours(name) or name in self._added or name in self._installed

    def _place(self, name: str) -> str:
        place = self._added.get(name) or self._installed.get(name, name)
        if not is_place(place):
            raise InputError(f"unknown {self.kind} '{name}'{among(name, self.names())}")
        _check_trusted(place, self.kind)
        return place

    def _made(self, name: str, target: Any, **details: Any) -> Any:
        return target if self._make is None else self._make(name, target, **details)


@cache
def plugin_packages() -> dict[str, EntryPoint]:
    """Return the entry points of the installed packages that declare plug-ins, by package."""
    return {point.value: point for point in entry_points(group=_PLUGINS)}


def _packages(package: str) -> list[str]:
    """Return the registry's own package, and the packages that declare plug-ins."""
    return [package, *plugin_packages()]


@cache
def _modules(folder: str, package: str) -> list[str]:
    modules = []
    for top in _packages(package):
        spec = importlib.util.find_spec(top)
        root = Path(spec.origin).parent if spec and spec.origin else Path()
        for path in sorted([root / folder, *root.glob(f"*/{folder}/")]):
            if (path / "__init__.py").is_file():
                name = ".".join((top, *path.relative_to(root).parts))
                found = pkgutil.iter_modules([str(path)])
                modules += [name, *(f"{name}.{module.name}" for module in found)]
        if (root / f"{folder}.py").is_file():
            modules.append(f"{top}.{folder}")
    return modules


def load(place: str, purpose: str) -> Any:
    """Import and return the object at a place (``module:Name`` or ``file.py:Name``).

    Raises InputError, whose message begins with `purpose`, if the place is not trusted or the
    import fails.
    """
    module, _, name = place.rpartition(":")
    if not module:
        raise InputError(f"{purpose}: '{place}' is not of the form module:Name or file.py:Name")
    _check_trusted(place, purpose)
    try:
        with chdir("."):  # and back, if the module changes the folder
            return getattr(_imported(module), name)
    except InputError:
        raise
    except (ImportError, OSError, AttributeError, SyntaxError) as error:
        raise InputError(f"{purpose}: cannot load '{place}' ({error})") from error
    except (Exception, SystemExit) as error:
        raise InputError(f"{purpose}: cannot load '{place}' ({error_text(error)})") from error


def _check_trusted(place: str, purpose: str) -> None:
    if place not in _trusted:
        raise InputError(
            f"{purpose}: {place!r} is code that is not loaded: neither the command line nor the "
            "configuration names it"
        )


def _imported(name: str) -> ModuleType:
    if not name.endswith(".py"):
        return importlib.import_module(name)
    path = Path(name).resolve()
    top = import_folder(path)
    if str(top) not in sys.path:
        sys.path.append(str(top))  # for good: the module may import others when it codes
    is_in_package = top != path.parent
    inner = ".".join(path.relative_to(top).with_suffix("").parts)
    _check_visible(path, top)
    return importlib.import_module(inner) if is_in_package else _imported_file(path)


def _imported_file(path: Path) -> ModuleType:
    """Import a file that is in no package, as importlib's documentation shows.

    The module gets a unique name, because files may have equal names, and an entry in
    `sys.modules`, where pickle looks for a class's module.
    """
    name = f"{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _check_visible(path: Path, top: Path) -> None:
    """Raise ImportError if a module elsewhere hides an equally named one that a file imports."""
    text = path.read_text(encoding="utf-8", errors="replace")
    for name in re.findall(r"^\s*(?:from|import)\s+(\w+)", text, re.M):
        for own in (top / f"{name}.py", top / name / "__init__.py"):
            spec = importlib.util.find_spec(name) if own.is_file() else None
            if spec and spec.origin and not Path(spec.origin).is_relative_to(top):
                raise ImportError(f"{own} is hidden by {spec.origin}: rename it")

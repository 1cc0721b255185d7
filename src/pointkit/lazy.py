"""Packages whose names are imported from their modules only on first use."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

PublicNames = tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]


def lazy(package: str, **modules: tuple[str, ...]) -> PublicNames:
    """Return what a package's ``__init__`` needs to import its names only on first use.

    Parameters
    ----------
    package
        The package's ``__name__``.
    **modules
        Names to make available, as a tuple for each module. No name may equal that of a module.

    Returns
    -------
    tuple
        ``__getattr__``, ``__dir__`` and ``__all__`` for the package.

    Examples
    --------
    In an ``__init__.py``, with the same imports for type checkers::

        if TYPE_CHECKING:
            from package.coder import decode as decode

        __getattr__, __dir__, __all__ = lazy(__name__, coder=("decode",))
    """
    module_of = {name: module for module, names in modules.items() for name in names}

    @cache
    def get_attribute(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{module_of[name]}"), name)

    names = sorted(module_of)
    return get_attribute, lambda: names, names


def imported(place: str) -> Any:
    """Import and return the object at ``module:Name``; used for modules that are rarely needed."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)

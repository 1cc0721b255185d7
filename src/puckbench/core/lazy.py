"""Public names of a package, each imported when it is first used (PEP 562)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

PublicNames = tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]


def lazy(package: str, **modules: tuple[str, ...]) -> PublicNames:
    """Offer names of a package's modules as the package's own, without importing the modules.

    Parameters
    ----------
    package
        The ``__name__`` of the package.
    **modules
        Module of the package, and the names to offer from it. No name may be that of a module.

    Returns
    -------
    tuple
        Functions ``__getattr__`` and ``__dir__`` and the list ``__all__`` for the package.

    Examples
    --------
    In the ``__init__.py`` of a package, with the same imports again for type checkers::

        if TYPE_CHECKING:
            from package.coder import decode as decode
            from package.coder import encode as encode

        __getattr__, __dir__, __all__ = lazy(__name__, coder=("decode", "encode"))
    """
    module_of = {name: module for module, names in modules.items() for name in names}

    def get_attribute(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{module_of[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    names = sorted(module_of)
    return get_attribute, lambda: names, names

"""Classes named in a table or a configuration: ``module:Class`` or ``path/to/file.py:Class``."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

from puckbench.errors import InputError


def load_class(where: str, what: str) -> Any:
    """The class at `where`; InputError (naming `what` it is for) when there is none."""
    module_name, _, class_name = where.rpartition(":")
    if not module_name:
        raise InputError(f"{what}: '{where}' is not of the form module:Class or file.py:Class")
    try:
        module = _module(module_name)
        return getattr(module, class_name)
    except (ImportError, OSError, AttributeError, SyntaxError) as error:
        raise InputError(f"{what}: cannot load '{where}' ({error})") from error


def _module(name: str) -> ModuleType:
    if not name.endswith(".py"):
        return importlib.import_module(name)
    spec = importlib.util.spec_from_file_location(Path(name).stem, name)
    if spec is None or spec.loader is None:
        raise ImportError(f"{name} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module

"""Classes named in a table or a configuration: ``module:Class`` or ``path/to/file.py:Class``."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from puckbench.core.errors import InputError


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
    path = Path(name).resolve()
    # A name of its own, since data classes and pickle look for the module of a class by its name.
    own = f"{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(own, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{name} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[own] = module
    spec.loader.exec_module(module)
    return module

"""Fingerprints of code: a job runs again when the code that makes its output changes.

The fingerprint covers the job's module, its plug-ins and all imports, without comments, docstrings
and help texts. The command line and the registries are excluded, so that a new plug-in does not
repeat other jobs. YAML files with the name of a module, or in the folder of a package's
``__init__.py``, are included.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from puckbench.core.imports import is_for_types, module_file, reached_files, top_folder


@cache
def code_version(*modules: str) -> str:
    """Return the fingerprint (16 hexadecimal digits) of modules and all their imports.

    A module is a dotted name or the path of a Python file.
    """
    files = sorted((str(file.relative_to(top_folder(file))), file) for file in covered(*modules))
    lines = "\n".join(f"{name} {_code_digest(file)}" for name, file in files)
    return hashlib.sha256(lines.encode()).hexdigest()[:16]


def covered(*modules: str) -> set[Path]:
    return reached_files(*_source_files(modules), is_left_out=_is_left_out)


def _source_files(modules: tuple[str, ...]) -> Iterator[Path]:
    for name in modules:
        if name.endswith(".py"):
            yield Path(name).absolute()
        elif file := module_file(name):
            yield file
        elif (spec := importlib.util.find_spec(name)) and str(spec.origin).endswith(".py"):
            yield Path(str(spec.origin))


def _is_left_out(file: Path) -> bool:
    package, *inner = file.relative_to(top_folder(file)).parts
    return package == "puckbench" and (inner[0] == "cli" or inner[-1].endswith("registry.py"))


@cache
def _code_digest(file: Path) -> str:
    words: list[str] = []
    _add_words(ast.parse(file.read_bytes()), words)
    data = b"".join(each.read_bytes() for each in data_files(file))
    return hashlib.sha256(" ".join(words).encode() + data).hexdigest()


def data_files(module: Path) -> list[Path]:
    """Return the YAML files that belong to a module or package."""
    if module.name == "__init__.py":
        return sorted(module.parent.glob("*.yaml"))
    return [each for each in [module.with_suffix(".yaml")] if each.is_file()]


def _add_words(value: Any, words: list[str]) -> None:
    """Append words for code without docstrings, imports for type checkers and help texts.

    This takes a third of the time of `ast.dump`.
    """
    if isinstance(value, ast.AST):
        words.append(type(value).__name__)
        is_option = isinstance(value, ast.Call) and getattr(value.func, "id", "") == "Field"
        for name in value._fields:
            inner: Any = getattr(value, name, None)
            if is_option and name == "keywords":
                inner = [word for word in inner if word.arg != "description"]
            if name != "ctx":
                _add_words(inner, words)
    elif isinstance(value, list):
        words.append("[")
        for inner in value:
            for each in inner.orelse if is_for_types(inner) else [inner]:
                if not _is_text(each):
                    _add_words(each, words)
        words.append("]")
    else:
        words.append(repr(value))


def _is_text(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)

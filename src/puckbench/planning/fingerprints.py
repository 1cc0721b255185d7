"""A fingerprint of the code that makes an artefact, so that only what it changes is re-made.

The fingerprint covers a module and every puckbench module that it imports, directly or not,
by their syntax trees without docstrings: an edited comment re-makes nothing. Registries are left
out: a new entry changes nothing that is made with the others. A module's numbers in a YAML file of
its name count as they stand.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_PACKAGE = "puckbench"
_ROOT = Path(__file__).parents[1]
_REGISTRIES = {"REGISTRY", "FIGURES"}


@cache
def code_version(*modules: str) -> str:
    """Fingerprint (16 hexadecimal digits) of `modules` and of all that they import.

    A module is a dotted name, within puckbench or of another package, or the path of a Python file.
    """
    found: dict[str, str] = {}
    for module in modules:
        _collect(module, found)
    lines = "\n".join(f"{name} {found[name]}" for name in sorted(found))
    return hashlib.sha256(lines.encode()).hexdigest()[:16]


def imports(tree: ast.Module) -> Iterator[str]:
    """Dotted names of the puckbench modules that a syntax tree may import, at any depth."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _ours(alias.name))
        elif isinstance(node, ast.ImportFrom) and node.module and _ours(node.module):
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _ours(name: str) -> bool:
    return name == _PACKAGE or name.startswith(f"{_PACKAGE}.")


def _collect(module: str, found: dict[str, str]) -> None:
    """Add a module, its packages and what they import to `found`."""
    source = _source(module)
    if module in found or source is None:
        return
    digest, imported = _read(source)
    found[module] = digest
    is_ours = _ours(module) and not module.endswith(".py")
    package = module.rpartition(".")[0] if is_ours else ""
    for name in (*imported, *([package] if package else [])):
        _collect(name, found)


@cache
def _source(module: str) -> Path | None:
    """File of a module, found without importing any of ours; None for a name within a module."""
    if module.endswith(".py"):
        return Path(module)
    if not _ours(module):
        found = importlib.util.find_spec(module)
        origin = found.origin if found else None
        return Path(origin) if origin and origin.endswith(".py") else None
    base = _ROOT.joinpath(*module.split(".")[1:])
    files = (base.with_suffix(".py"), base / "__init__.py")
    return next((file for file in files if file.is_file()), None)


@cache
def _read(source: Path) -> tuple[str, tuple[str, ...]]:
    tree = ast.parse(source.read_text(encoding="utf-8"))
    imported = tuple(imports(tree))
    tree.body = [node for node in tree.body if not _is_registry(node)]
    for node in ast.walk(tree):
        _drop_docstring(node)
    numbers = source.with_suffix(".yaml")
    data = numbers.read_bytes() if numbers.is_file() else b""
    return hashlib.sha256(ast.dump(tree).encode() + data).hexdigest(), imported


def _is_registry(node: ast.stmt) -> bool:
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return any(isinstance(name, ast.Name) and name.id in _REGISTRIES for name in targets)


def _drop_docstring(node: ast.AST) -> None:
    body = getattr(node, "body", None)
    if not isinstance(body, list) or not body:
        return
    first = body[0]
    if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
        body[0] = ast.Pass()

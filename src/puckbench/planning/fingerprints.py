"""Fingerprints of code: a job runs again when the code that makes its output changes.

That code is the job's module, its plug-in's, all their imports, and YAML files with their names,
without comments, docstrings and help texts. The command line and the registries are excluded, so
that a new plug-in does not repeat other jobs.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterator
from functools import cache
from pathlib import Path

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
    tree = _Code().visit(ast.parse(file.read_bytes()))
    numbers = file.with_suffix(".yaml")
    data = numbers.read_bytes() if numbers.is_file() else b""
    return hashlib.sha256(ast.dump(tree).encode() + data).hexdigest()


class _Code(ast.NodeTransformer):
    """Removes docstrings, imports for type checkers, and help texts of options."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        return None if is_for_types(node) else self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if getattr(node.func, "id", "") == "Field":
            node.keywords = [word for word in node.keywords if word.arg != "description"]
        return self.generic_visit(node)

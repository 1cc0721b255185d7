"""Fingerprints of the code that makes an artefact, so that a job runs again when that code changes.

Code is the module of a job, that of its plug-in and all that they import, as syntax: comments,
docstrings and help texts do not count. The command line and the registries are left out, so that a
new plug-in re-makes nothing that the others made. A YAML file of a module's name counts as it is.
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
    """Fingerprint of `modules` and of all that they import.

    Parameters
    ----------
    *modules
        Dotted names, of puckbench or of another installed package, or paths of Python files.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    files = sorted((str(file.relative_to(top_folder(file))), file) for file in covered(*modules))
    lines = "\n".join(f"{name} {_code_digest(file)}" for name, file in files)
    return hashlib.sha256(lines.encode()).hexdigest()[:16]


def covered(*modules: str) -> set[Path]:
    """The files that a fingerprint of `modules` covers."""
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
    """Digest of the code of one file, and of the numbers beside it."""
    tree = _Code().visit(ast.parse(file.read_bytes()))
    numbers = file.with_suffix(".yaml")
    data = numbers.read_bytes() if numbers.is_file() else b""
    return hashlib.sha256(ast.dump(tree).encode() + data).hexdigest()


class _Code(ast.NodeTransformer):
    """Leaves out what is not run, and help texts."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """A docstring, or another text that stands alone, does nothing."""
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        """What is imported for type checkers alone is never run."""
        return None if is_for_types(node) else self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """The description of an option is its help text."""
        if getattr(node.func, "id", "") == "Field":
            node.keywords = [word for word in node.keywords if word.arg != "description"]
        return self.generic_visit(node)

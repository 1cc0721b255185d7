"""Search for the source files that a Python file imports, directly or indirectly.

The search covers files of puckbench, of the file's package, and of the file's folder. Other
installed packages are ignored. Imports for type checkers are ignored, except those of a lazy
package (`puckbench.core.lazy`), which name the modules of its public names.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).parents[1]
_INSTALLED = {"site-packages", "dist-packages"}
"""Folders in which unrelated packages lie beside each other."""


def reached_files(*files: Path, is_left_out: Callable[[Path], bool] | None = None) -> set[Path]:
    """Return Python files and all their imports, except those for which `is_left_out` is true."""
    reached: set[Path] = set()
    queue = list(files)
    while queue:
        file = queue.pop()
        if file not in reached:
            reached.add(file)
            imported = imported_files(file)
            queue += (each for each in imported if not (is_left_out and is_left_out(each)))
    return reached


@cache
def imported_files(file: Path) -> frozenset[Path]:
    if not file.is_file():  # a cell of a notebook
        return frozenset()
    return frozenset(_imported(ast.parse(file.read_bytes()), file))


def _imported(node: ast.AST, importer: Path) -> Iterator[Path]:
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield from _of_module(_file(alias.name, importer))
    elif isinstance(node, ast.ImportFrom):
        package = _absolute(node, importer)
        for alias in node.names:  # a module of the package, or what its __init__ defines
            inner = _file(f"{package}.{alias.name}".lstrip("."), importer)
            outer = _file(package, importer) if package else None
            yield from _of_module(inner) if inner else _of_module(outer, alias.name)
    elif not isinstance(node, ast.expr) and not is_for_types(node):
        for child in ast.iter_child_nodes(node):
            yield from _imported(child, importer)


def _of_module(file: Path | None, name: str = "*") -> Iterator[Path]:
    """Yield a module's file and, of a lazy package, the files of a public name or of all."""
    if file is not None:
        yield file
        public = _lazy_imports(file) if file.name == "__init__.py" else {}
        yield from public.values() if name == "*" else filter(None, [public.get(name)])


@cache
def _lazy_imports(package: Path) -> dict[str, Path]:
    """Return the files of a lazy package's public names, which it imports for type checkers."""
    blocks = filter(is_for_types, ast.parse(package.read_bytes()).body)
    statements = (node for block in blocks for node in ast.walk(block))
    return {
        alias.asname or alias.name: file
        for node in statements
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if (file := _file(_absolute(node, package), package))
    }


def is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"


def _absolute(statement: ast.ImportFrom, importer: Path) -> str:
    if not statement.level:
        return statement.module or ""
    parts = importer.relative_to(top_folder(importer)).parts[: -statement.level]
    return ".".join([*parts, *filter(None, [statement.module])])


def _file(name: str, importer: Path) -> Path | None:
    top, first = top_folder(importer), name.partition(".")[0]
    is_near = top.name not in _INSTALLED or importer.relative_to(top).parts[0] == first
    file = module_file(name, top) if is_near else None
    return file or (module_file(name) if first == _PACKAGE.name else None)


@cache
def top_folder(file: Path) -> Path:
    """Return the folder that contains the top-level package of a file."""
    folder = file.parent
    while (folder / "__init__.py").exists():
        folder = folder.parent
    return folder


@cache
def module_file(name: str, folder: Path = _PACKAGE.parent) -> Path | None:
    base = folder / name.replace(".", "/")
    files = (base.with_name(f"{base.name}.py"), base / "__init__.py")
    return next((file for file in files if file.is_file()), None)

"""Search for the source files that a Python file imports, directly or indirectly.

The search covers files of puckbench, of the file's package, and of the file's folder. Other
installed packages are ignored. Imports for type checkers are ignored, except those of a lazy
package (`pointkit.lazy`), which name the modules of its public names.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeGuard

_PACKAGE = Path(__file__).parents[1]
_INSTALLED = {"site-packages", "dist-packages"}
"""Folders in which unrelated packages lie beside each other."""


class _Importer(NamedTuple):
    """A Python file, and where its imports are searched.

    Parameters
    ----------
    file
        File whose imports are searched, first in its own top folder.
    folders
        Folders to search next. They are given for files of users, which may import modules beside
        each other; for other files, there are none.
    """

    file: Path
    folders: tuple[Path, ...] = ()

    def find(self, name: str) -> Path | None:
        """Return the file of a module; None if it belongs to another installed package."""
        top, first = top_folder(self.file), name.partition(".")[0]
        is_near = top.name not in _INSTALLED or self.file.relative_to(top).parts[0] == first
        near = [top, *self.folders] if is_near else []
        folders = [*near, *([_PACKAGE.parent] if first == _PACKAGE.name else [])]
        return next(filter(None, (module_file(name, folder) for folder in folders)), None)


def reached_files(*files: Path, is_left_out: Callable[[Path], bool] | None = None) -> set[Path]:
    """Return Python files and all their imports, except those for which `is_left_out` is true.

    As when a job runs, code of users may import modules beside any of the files, and modules in the
    working folder.
    """
    own = sorted({top_folder(file) for file in files if _is_of_user(file)})
    folders = (*own, Path.cwd()) if own else ()
    reached: set[Path] = set()
    queue = list(files)
    while queue:
        file = queue.pop()
        if file not in reached:
            reached.add(file)
            imported = imported_files(file, folders)
            queue += (each for each in imported if not (is_left_out and is_left_out(each)))
    return reached


@cache
def imported_files(file: Path, folders: tuple[Path, ...] = ()) -> frozenset[Path]:
    """Return the files that a file imports, found in its top folder or in `folders`."""
    if not file.is_file():  # a cell of a notebook
        return frozenset()
    importer = _Importer(file, folders if _is_of_user(file) else ())
    return frozenset(_imported(ast.parse(file.read_bytes()), importer))


def _imported(node: ast.AST, importer: _Importer) -> Iterator[Path]:
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield from _of_module(importer.find(alias.name))
    elif isinstance(node, ast.ImportFrom):
        package = _absolute(node, importer.file)
        for alias in node.names:  # a module of the package, or what its __init__ defines
            inner = importer.find(f"{package}.{alias.name}".lstrip("."))
            outer = importer.find(package) if package else None
            yield from _of_module(inner) if inner else _of_module(outer, alias.name)
    elif not isinstance(node, ast.expr):
        for child in node.orelse if is_for_types(node) else ast.iter_child_nodes(node):
            yield from _imported(child, importer)


def _of_module(file: Path | None, name: str = "*") -> Iterator[Path]:
    """Yield a module's file, those of a user's packages around it, and those of a lazy package.

    Of a lazy package, these are the files of the public name, or of all for ``*``.
    """
    if file is None:
        return
    yield file
    if _is_of_user(file):
        folders = (parent for parent in file.parents if parent.is_relative_to(top_folder(file)))
        yield from filter(Path.is_file, (folder / "__init__.py" for folder in folders))
    public = _lazy_imports(file) if file.name == "__init__.py" else {}
    yield from public.values() if name == "*" else filter(None, [public.get(name)])


def _is_of_user(file: Path) -> bool:
    """Return whether a file is neither of puckbench nor of an installed package."""
    return not file.is_relative_to(_PACKAGE) and top_folder(file).name not in _INSTALLED


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
        if (file := _Importer(package).find(_absolute(node, package)))
    }


def is_for_types(node: object) -> TypeGuard[ast.If]:
    """Return whether a statement is ``if TYPE_CHECKING``, whose ``else`` is what runs."""
    return isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"


def _absolute(statement: ast.ImportFrom, importer: Path) -> str:
    if not statement.level:
        return statement.module or ""
    parts = importer.relative_to(top_folder(importer)).parts[: -statement.level]
    return ".".join([*parts, *filter(None, [statement.module])])


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

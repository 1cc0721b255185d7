"""Fingerprints of the code that makes an artefact, so that a job runs again when that code changes.

A fingerprint covers the modules of a job and of its plug-in and every puckbench module that they
import, directly or not. Of each it covers the syntax tree without what cannot change a result:
comments, docstrings and help texts, registrations and how a plug-in is presented (title, colour).
The command line and the registries are left out, so that a new plug-in re-makes nothing that the
others made. A package's ``__init__`` counts only where a name that it defines is imported; a name
that it re-exports leads to the module that defines it. A YAML file of a module's name counts as it
stands.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

_PACKAGE = "puckbench"
_PRESENTATION = {"title", "colour", "marker", "line", "rank", "category", "thesis"}
_RECORDED = {"rates", "memory", "pace"}
"""Of a class: what a job's own record has, or what only plans use."""
_HELP = {"help", "description"}
_HELPED_CALLS = {"add_argument", "add_parser", "Field"}
_NOT_CODE = ("puckbench.cli",)


@cache
def code_version(*modules: str) -> str:
    """Fingerprint of `modules` and of all that they import, in puckbench's own sources.

    Parameters
    ----------
    *modules
        Dotted names, of puckbench or of another installed package, or paths of Python files.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    return _own_sources().code_version(*modules)


@cache
def _own_sources() -> Sources:
    return Sources(Path(__file__).parents[1])


class Sources:
    """A tree of puckbench's sources, each file read once.

    Parameters
    ----------
    root
        The folder of the package ``puckbench``.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._modules: dict[str, _Module | None] = {}
        self._needed: dict[str, tuple[str, ...]] = {}

    def code_version(self, *modules: str) -> str:
        """Fingerprint (16 hexadecimal digits) of `modules` and of all that they import."""
        found = ((name, self._module(name)) for name in sorted(self.covered(*modules)))
        lines = "\n".join(f"{name} {module.digest}" for name, module in found if module)
        return hashlib.sha256(lines.encode()).hexdigest()[:16]

    def covered(self, *modules: str) -> set[str]:
        """The modules that a fingerprint of `modules` covers."""
        found: set[str] = set()
        waiting = [name for name in modules if self._module(name) is not None]
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                waiting += self._imported(name)
        return found

    def _imported(self, name: str) -> tuple[str, ...]:
        """The puckbench modules that define what a module imports."""
        if name not in self._needed:
            module = self._module(name)
            wanted = module.imports if module else ()
            found = {target for each in wanted for target in self._defining(each)}
            self._needed[name] = tuple(sorted(found))
        return self._needed[name]

    def _defining(self, wanted: Import) -> Iterator[str]:
        """The module that an import brings in, unless it is no code of a result."""
        inner = f"{wanted.module}.{wanted.name}"
        if wanted.name and self._module(inner) is not None:
            yield from self._counted(inner)
            return
        module = self._module(wanted.module)
        origin = module.re_exports.get(wanted.name) if module else None
        if origin is not None:
            yield from self._defining(origin)
        elif module is not None and (wanted.name or not module.is_package):
            yield from self._counted(wanted.module)

    def _counted(self, name: str) -> Iterator[str]:
        is_code = not any(name == left or name.startswith(f"{left}.") for left in _NOT_CODE)
        if is_code and not name.endswith(".registry"):
            yield name

    def _module(self, name: str) -> _Module | None:
        if name not in self._modules:
            path = self._path(name)
            self._modules[name] = None if path is None else _Module.read(path)
        return self._modules[name]

    def _path(self, name: str) -> Path | None:
        """File of a module, found without importing ours; None for a name within a module."""
        if name.endswith(".py"):
            return Path(name)
        if not _is_ours(name):
            found = importlib.util.find_spec(name)
            origin = found.origin if found else None
            return Path(origin) if origin and origin.endswith(".py") else None
        base = self._root.joinpath(*name.split(".")[1:])
        files = (base.with_suffix(".py"), base / "__init__.py")
        return next((file for file in files if file.is_file()), None)


@dataclass(frozen=True)
class Import:
    """``from module import name``; without a name ``import module``."""

    module: str
    name: str = ""


@dataclass(frozen=True)
class _Module:
    """What counts of one source file; its syntax tree, of some 300 KiB, is not kept.

    imports: what the module's code imports; of a package, what its own code uses of that.
    re_exports: where a package's names come from that it does not define. digest: of the code and
    of the numbers beside it.
    """

    is_package: bool
    imports: tuple[Import, ...]
    re_exports: dict[str, Import]
    digest: str

    @classmethod
    def read(cls, path: Path) -> _Module:
        """The module of a source file."""
        tree: ast.Module = _Code().visit(ast.parse(path.read_text(encoding="utf-8")))
        is_package = path.name == "__init__.py"
        bound = tuple(imports(tree))
        used = tuple(found for _, found in bound)
        if is_package:
            names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
            used = tuple(found for name, found in bound if name in names)
            tree = ast.Module([node for node in tree.body if not _is_import(node)], [])
        numbers = path.with_suffix(".yaml")
        data = numbers.read_bytes() if numbers.is_file() else b""
        digest = hashlib.sha256(ast.dump(tree).encode() + data).hexdigest()
        return cls(is_package, used, dict(bound) if is_package else {}, digest)


def imports(tree: ast.AST) -> Iterator[tuple[str, Import]]:
    """What a syntax tree may import of puckbench, at any depth, with the names that it binds."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            ours = [alias for alias in node.names if _is_ours(alias.name)]
            yield from ((alias.asname or alias.name, Import(alias.name)) for alias in ours)
        elif isinstance(node, ast.ImportFrom) and _is_ours(module := node.module or ""):
            names = [(alias.asname or alias.name, alias.name) for alias in node.names]
            yield from ((bound, Import(module, name)) for bound, name in names)


def _is_ours(name: str) -> bool:
    return name == _PACKAGE or name.startswith(f"{_PACKAGE}.")


def _is_import(node: ast.stmt) -> bool:
    return isinstance(node, ast.Import | ast.ImportFrom)


class _Code(ast.NodeTransformer):
    """Leaves of a module what can change a result."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """A docstring, or another text that stands alone, does nothing."""
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        """What is imported for type checkers alone is never run."""
        return None if _name_of(node.test) == "TYPE_CHECKING" else self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        """Registries, and the lists of a module's public names, change no result."""
        return None if _is_registry(node) else self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        """As an assignment without annotation."""
        return None if _is_registry(node) else self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Options stay, their help texts go."""
        if _name_of(node.func) in _HELPED_CALLS:
            node.keywords = [word for word in node.keywords if word.arg not in _HELP]
        return self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Functions stay, their registrations go."""
        node.decorator_list = [each for each in node.decorator_list if not _registers(each)]
        return self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Classes stay, their registrations go, and how plug-ins are presented."""
        kept = [each for each in node.decorator_list if not _registers(each)]
        if len(kept) < len(node.decorator_list) or any(map(_is_plugin, node.bases)):
            node.body = [each for each in node.body if not _presents(each)]
        node.decorator_list = kept
        return self.generic_visit(node)


def _name_of(node: ast.AST) -> str:
    """The last part of a name: ``register`` of ``CODECS.register``."""
    return str(getattr(node, "attr", getattr(node, "id", "")))


def _registers(decorator: ast.expr) -> bool:
    return isinstance(decorator, ast.Call) and _name_of(decorator.func) == "register"


def _is_plugin(base: ast.expr) -> bool:
    return _name_of(base).endswith("Codec")


def _presents(node: ast.stmt) -> bool:
    return bool(_assigned(node) & (_PRESENTATION | _RECORDED))


def _is_registry(node: ast.Assign | ast.AnnAssign) -> bool:
    value: Any = node.value.func if isinstance(node.value, ast.Call) else None
    value = value.value if isinstance(value, ast.Subscript) else value
    return _name_of(value) == "Registry" or "__all__" in _assigned(node)


def _assigned(node: ast.stmt) -> set[str]:
    if isinstance(node, ast.Assign):
        return {_name_of(target) for target in node.targets if isinstance(target, ast.Name)}
    return {_name_of(node.target)} if isinstance(node, ast.AnnAssign) else set()

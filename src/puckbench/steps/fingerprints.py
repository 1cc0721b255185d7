"""Fingerprints of code: a job runs again when the code that makes its output changes.

The code of a job is the module that defines it, what this module and the job's plug-ins name in
their constant ``CODE`` (`puckbench.core.code`), and the package pointkit. Comments, docstrings and
help texts do not count. A YAML file counts with the Python file of the same name beside it, and
with the package in whose folder it lies.

The code of a user's file is the Python files of its package or, outside a package, of its folder
and the folders directly in it, but for files of other plug-ins that it does not mention. The
user's modules that the file imports count too (`puckbench.steps.user_code`). The code of a module
of another installed package is that whole package. In both cases, all packages of this repository
that puckbench builds on (`ENGINES`) count as well.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import re
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from cloud_files.meshes import reading as meshes
from pointkit.registry import Registry, trusted_files
from pointkit.sources import import_folder, package_files, package_folder
from puckbench.core.packages import ENGINES, package_folders
from puckbench.figures.registry import FIGURES
from puckbench.steps.user_code import imported_files
from puckbench.tables.registry import TABLES
from virtual_lidar.errors import ERROR_MODELS

ALWAYS = ("pointkit.*",)
"""Packages that count as code of every job."""
_PLUGINS: dict[str, Registry[Any]] = {
    "puckbench.figures": FIGURES,
    "puckbench.tables": TABLES,
    "virtual_lidar.errors": ERROR_MODELS,
}
"""Packages of puckbench with plug-ins, whose modules count only where a job names them."""
_READERS = {"cloud_files.meshes": meshes.READERS}
"""Packages with readers of file formats, which count only where a job reads such files."""


@cache
def code_version(*names: str) -> str:
    """Return a fingerprint of code, as 16 hexadecimal digits that change when the code changes.

    Parameters
    ----------
    names
        Names of modules or packages, as in `puckbench.core.code`, or paths of the user's files.
    """
    files = sorted((_short(file), file) for file in covered(*names))
    lines = "\n".join(f"{name} {_code_digest(file)}" for name, file in files)
    return hashlib.sha256(lines.encode()).hexdigest()[:16]


@cache
def covered(*names: str) -> frozenset[Path]:
    """Return the paths of all Python and YAML files that `code_version` of these names reads."""
    files: set[Path] = set()
    seen: set[str] = set()
    queue = [*ALWAYS, *names]
    while queue:
        name = queue.pop()
        if name not in seen:
            seen.add(name)
            more, inner = _files_and_names(name)
            files |= more
            queue += inner
    return frozenset(files)


def _files_and_names(name: str) -> tuple[set[Path], tuple[str, ...]]:
    """Return the files of one name, and the further names whose code counts with it."""
    engines = tuple(f"{engine}.*" for engine in ENGINES)
    if name.endswith(".py"):
        return _files_of_user(Path(name)), engines
    top, _, inner = name.removesuffix(".*").partition(".")
    folder = _ours().get(top)
    if folder is None:
        file = Path(str(importlib.import_module(name).__file__))
        return {*package_files(package_folder(file)), *_imported_by(file)}, engines
    place = folder.joinpath(*filter(None, inner.split(".")))
    if name.endswith(".*"):
        return {*place.rglob("*.py"), *_data_below(place)}, ()
    if place.is_dir():
        stems = {module.rpartition(".")[2] for module in _plugins_in(name)}
        left_out = {place / f"{stem}.{suffix}" for stem in stems for suffix in ("py", "yaml")}
        return {*place.glob("*.py"), *place.glob("*.yaml")} - left_out, ()
    file = place.with_suffix(".py")
    data = {file.with_suffix(".yaml")} if file.with_suffix(".yaml").is_file() else set()
    code = getattr(importlib.import_module(name), "CODE", None)
    if code is None and top not in ("puckbench", *ENGINES):
        return {*folder.rglob("*.py"), *_data_below(folder), *_imported_by(file)}, engines
    return {file, *data}, code or ()


@cache
def _ours() -> dict[str, Path]:
    return package_folders()


def _data_below(folder: Path, pattern: str = "**/*") -> Iterator[Path]:
    """Yield the YAML files beside which there is a Python file of the same name."""
    return (file for file in folder.glob(f"{pattern}.yaml") if file.with_suffix(".py").is_file())


@cache
def _plugins_in(room: str) -> set[str]:
    registry = _PLUGINS.get(room)
    modules = {registry.module_of(name) for name in registry.names()} if registry else set()
    return modules | {place.partition(":")[0] for place in _READERS.get(room, {}).values()}


def _files_of_user(file: Path) -> set[Path]:
    """Return the files that count as the code of a user's file."""
    folder = package_folder(file)
    beside = {*package_files(folder), *file.parent.glob("*/*.py"), *_data_below(file.parent, "*")}
    text = file.read_text(encoding="utf-8", errors="replace")
    others = (other for other in trusted_files() if other != file.absolute())
    beside -= {other for other in others if not re.search(rf"\b{other.stem}\b", text)}
    return {file, *beside, *_imported_by(file)}


def _imported_by(file: Path) -> set[Path]:
    return {each for each in imported_files(file) if each.suffix == ".py"}


def _short(file: Path) -> str:
    """Return a file's path relative to the folder that contains the file's package."""
    return file.relative_to(import_folder(file)).as_posix()


@cache
def _code_digest(file: Path) -> str:
    content = file.read_bytes()
    if file.suffix == ".py":
        with suppress(SyntaxError, ValueError):  # of a file that no codec imports
            words: list[str] = []
            _add_words(ast.parse(content), words)
            content = " ".join(words).encode()
    return hashlib.sha256(content).hexdigest()


def _add_words(value: Any, words: list[str]) -> None:
    """Append words that describe a syntax tree without docstrings, type imports and help texts."""
    # This takes a third of the time of `ast.dump`.
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
            for each in inner.orelse if _is_for_types(inner) else [inner]:
                if not _is_text(each):
                    _add_words(each, words)
        words.append("]")
    else:
        words.append(repr(value))


def _is_text(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_for_types(node: object) -> bool:
    """Return whether a statement is ``if TYPE_CHECKING``, so that only its ``else`` runs."""
    return isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"

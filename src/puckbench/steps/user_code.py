"""What the code of a user's plug-in reaches: modules elsewhere, and files that it names.

The syntax trees of the plug-in and of its modules tell both, so that no code runs. A file counts if
a text in the code names it: ``"table.json"``, ``f"{rate}.npz"``, ``".npz"`` or ``"models/*.pt"``.
"""

from __future__ import annotations

import ast
import os
import re
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator, Sequence, Set
from contextlib import suppress
from fnmatch import fnmatchcase
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from pointkit.sources import import_folder
from puckbench.core.packages import ENGINES, package_folders

_OURS = ("puckbench", *ENGINES)
_INSTALLED = {"site-packages", "dist-packages"}
_SYSTEM = tuple(map(Path, ("/dev", "/proc", "/sys")))
_LIBRARY = re.compile(r"(?P<stem>[^.]+).*\.(so|dylib|dll|pyd)(\.\d+)*")
_PLACEHOLDER = re.compile(r"\{[^{}]*\}|%[-+ #.\d]*[A-Za-z]")
"""Part of a text that `str.format` or the operator ``%`` replaces."""
_LONGEST = 255
"""Number of bytes of the longest text that is taken for a path."""
_DEEPEST = 8
"""Number of nested folders that are searched."""


@cache
def imported_files(plugin: Path) -> frozenset[Path]:
    """Return the files of the user's modules that a Python file imports, directly or not.

    Left out are modules of Python, of this repository, and of installed packages that are not
    editable. Extension modules, which are shared libraries, are included.
    """
    found: set[Path] = set()
    queue = [plugin]
    while queue:
        file = queue.pop()
        for name in _read(file).imports:
            new = {*_files_of_module(name, import_folder(file))} - found
            found |= new
            queue += (each for each in new if each.suffix == ".py")
    return frozenset(found)


def named_files(plugin: Path, options: Iterable[str], without: Set[Path]) -> set[Path]:
    """Return the files that the code of a user's plug-in names, and the libraries that it imports.

    A named file is in the folder of the code, in the folder above, in the working folder, or in a
    folder in these that the code names too; or the code has its absolute path. Patterns such as
    ``*.npz`` are not applied to the folder above and to the working folder.

    Parameters
    ----------
    plugin
        File that defines the plug-in. The modules of the user that it imports may name files too.
    options
        Texts of the plug-in's options, which may name files.
    without
        Absolute paths of files and folders that are left out.
    """
    code = {plugin, *imported_files(plugin)}
    found = {file for file in code if file.suffix != ".py"}
    texts_by_file = {file: {*_read(file).texts} for file in code - found}
    texts_by_file[plugin] |= {text for text in options if _may_be_path(text)}
    named: dict[tuple[Path, bool], set[str]] = {}
    for file, texts in texts_by_file.items():
        names = {word for text in texts for word in _words(text)}
        paths = [Path(os.path.expanduser(t)) for t in texts if t.startswith(("/", "~/"))]  # noqa: PTH111 (Path raises without a home)
        found |= {path for path in paths if _is_file(path) and not _is_of_system(path)}
        for folder in (file.parent, *_folders_of(paths)):
            named.setdefault((folder, True), set()).update(names)
        for folder in (file.parent.parent, Path.cwd()):
            named.setdefault((folder, False), set()).update(names)
    for (folder, with_patterns), names in named.items():
        found |= {*_search(folder, _Names(names), with_patterns, without, _DEEPEST)}
    return found - without


def with_libraries(files: Iterable[Path]) -> set[Path]:
    """Return files, with the shared libraries that they link or load from their folders.

    The programs and libraries among the files contain the names of these libraries.
    """
    found: set[Path] = set()
    queue = [*files]
    while queue:
        file = queue.pop()
        found.add(file)
        if _is_library(file.name) or os.access(file, os.X_OK):
            with suppress(OSError):  # a program that can be run, but not read
                beside = {each for each in file.parent.iterdir() if _is_library(each.name)} - found
                content = file.read_bytes() if beside else b""
                queue += (each for each in beside if os.fsencode(each.name) in content)
    return found


def _is_library(name: str) -> bool:
    """Return whether a file name is one of a shared library, such as ``libx.so.1`` or ``x.pyd``."""
    return _LIBRARY.fullmatch(name) is not None


class _Code(NamedTuple):
    """What a Python file imports (dotted names of modules or of what is in them), and its texts."""

    imports: frozenset[str]
    texts: frozenset[str]


@cache
def _read(file: Path) -> _Code:
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return _Code(frozenset(), frozenset())
    package = file.relative_to(import_folder(file)).parts[:-1]
    return _Code(frozenset(_imports(tree, package)), frozenset(filter(_may_be_path, _texts(tree))))


def _imports(tree: ast.Module, package: Sequence[str]) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*above, *filter(None, [node.module])))
            names |= {f"{module}.{alias.name}".lstrip(".") for alias in node.names}
    return names


def _files_of_module(name: str, folder: Path) -> Iterator[Path]:
    """Yield the files of a module of the user and of the packages in which it lies.

    The module is searched for in `folder` first, and then where Python searches.
    """
    top, *rest = name.split(".")
    if top in _OURS or top in sys.stdlib_module_names:
        return
    spec = PathFinder.find_spec(top, [str(folder)]) or _spec(top)
    while spec is not None:
        if spec.has_location and spec.origin:
            if not _is_of_user(Path(spec.origin)):
                return
            yield Path(spec.origin).absolute()
        if not rest or spec.submodule_search_locations is None:
            return
        spec = PathFinder.find_spec(rest.pop(0), [*spec.submodule_search_locations])


def _spec(name: str) -> ModuleSpec | None:
    with suppress(ImportError, ValueError):
        return find_spec(name)
    return None


def _is_of_user(file: Path) -> bool:
    others = any(file.is_relative_to(each) for each in _folders_of_others())
    return not others and not _INSTALLED & {*file.parts}


@cache
def _folders_of_others() -> tuple[Path, ...]:
    ours = (folder for name, folder in package_folders().items() if name in _OURS)
    return *ours, *(Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib"))


def _texts(tree: ast.Module) -> Iterator[str]:
    """Yield the texts in code, with ``*`` for parts that are replaced when it runs."""
    parts: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts |= {id(part) for part in node.values}
            yield "".join(
                str(part.value) if isinstance(part, ast.Constant) else "*" for part in node.values
            )
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts
        ):
            yield _PLACEHOLDER.sub("*", node.value)


def _may_be_path(text: str) -> bool:
    return 0 < len(text.encode(errors="replace")) <= _LONGEST and not {"\n", "\0"} & {*text}


def _words(text: str) -> Iterator[str]:
    """Yield names of files and folders in a text, and patterns that end with a suffix."""
    for part in text.split("/"):
        word = f"*{part}" if re.fullmatch(r"\.\w+", part) else part
        if word and (not _is_pattern(word) or re.search(r"\.(?!py$)\w+\*?$", word)):
            yield word


def _is_pattern(word: str) -> bool:
    return "*" in word or "?" in word


class _Names:
    """Names and patterns of files, and names of folders."""

    def __init__(self, words: Iterable[str]) -> None:
        self._words = frozenset(words)
        self._patterns = [word for word in self._words if _is_pattern(word)]

    def has_folder(self, name: str) -> bool:
        return name in self._words

    def has_file(self, name: str, with_patterns: bool) -> bool:
        if library := _LIBRARY.fullmatch(name):
            stem = library["stem"]
            if not self._words.isdisjoint((stem, stem.removeprefix("lib"))):
                return True
        is_matched = with_patterns and any(fnmatchcase(name, each) for each in self._patterns)
        return is_matched or name in self._words


def _search(
    folder: Path, names: _Names, with_patterns: bool, without: Set[Path], depth: int
) -> Iterator[Path]:
    """Yield the files with such names in a folder and in the folders in it with such names."""
    with suppress(OSError):
        for entry in os.scandir(folder):
            path = folder / entry.name
            if path in without:
                continue
            if entry.is_dir():
                if depth and names.has_folder(entry.name):
                    yield from _search(path, names, True, without, depth - 1)
            elif names.has_file(entry.name, with_patterns) and entry.is_file():
                yield path


def _is_file(path: Path) -> bool:
    return os.path.isfile(path)  # noqa: PTH113 (Path raises if the user may not look)


def _folders_of(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield the folders among absolute paths, and those of the paths that are patterns."""
    for path in paths:
        folder = path.parent if _is_pattern(path.name) else path
        if len(folder.parts) > 2 and os.path.isdir(folder):  # noqa: PTH112 (as above)
            yield folder


def _is_of_system(file: Path) -> bool:
    """Return whether a file is none of the user, but of the system, or a temporary one."""
    is_temporary = file.parent == Path(tempfile.gettempdir())
    return is_temporary or any(file.is_relative_to(each) for each in _SYSTEM)

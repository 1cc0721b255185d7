"""Names of files in a bundle, by which a run can be repeated in any folder."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pointkit.errors import InputError
from pointkit.sources import import_folder

_ELSEWHERE = "elsewhere"
"""Name, in a bundle, of the first folder outside the working folder; others get numbers."""
_PATTERN = re.compile(r"[*?[]")
_CODE = re.compile(r"\.py(?=:|$)")


class _Named(NamedTuple):
    """A path in a configuration that leaves the working folder, and the folder it is taken from."""

    typed: str
    path: Path
    root: Path


class PublishedPaths:
    """Gives files names that are relative to the working folder and tell nothing of the machine.

    Files of the working folder keep their relative paths. Files elsewhere, which a configuration
    names by an absolute path or through ``..``, get a path in a new folder, and keep the names of
    the file and of its folder.

    Parameters
    ----------
    config
        The configuration.
    folder
        The working folder, in which the run was started.
    """

    def __init__(self, config: Mapping[str, Any], folder: Path) -> None:
        self._folder = Path(os.path.abspath(folder))  # noqa: PTH100 (links are kept)
        self._named = list(dict.fromkeys(filter(None, map(self._named_by, _texts(config)))))
        self._aliases: dict[Path, str] = {}
        for root in dict.fromkeys(each.root for each in self._named):
            if root != self._folder:
                self._aliases[root] = self._free_name()
        new = {each.typed: self._name(each.path, each.root) for each in self._named}
        self._new = {**new, str(self._folder): "."}
        typed = "|".join(re.escape(text) for text in sorted(self._new, key=len, reverse=True))
        self._typed = re.compile(rf"(?<![\w./-])({typed})(?![\w-]|\.\w)(/?)")

    def _named_by(self, text: str) -> _Named | None:
        code = _CODE.search(text)
        parts = (text[: code.end()] if code else text).split("/")
        fixed = next((k for k, part in enumerate(parts) if _PATTERN.search(part)), len(parts))
        typed = "/".join(parts[:fixed]).rstrip("/")
        path = Path(os.path.normpath(self._folder / typed))
        is_here = path.is_relative_to(self._folder)
        leaves = typed.startswith("/") or ".." in parts
        if not typed or not leaves or not os.path.lexists(path) or path == self._folder:
            return None
        if is_here:
            return _Named(typed, path, self._folder)
        if code:
            return _Named(typed, path, import_folder(path))
        return _Named(typed, path, path.parent if path.is_dir() else path.parent.parent)

    def _free_name(self) -> str:
        taken, number = {*self._aliases.values()}, 1
        while (name := _numbered(number)) in taken or (self._folder / name).exists():
            number += 1
        return name

    def _name(self, path: Path, root: Path) -> str:
        inner = path.relative_to(root).as_posix()
        return inner if root == self._folder else f"{self._aliases[root]}/{inner}"

    def in_text(self, text: str) -> str:
        """Return a text in which published names replace the paths that the configuration names."""

        def published(found: re.Match[str]) -> str:
            new = self._new[found[1]]
            return "" if (new, found[2]) == (".", "/") else new + found[2]

        return self._typed.sub(published, text)

    def in_values(self, value: Any) -> Any:
        """Return values of a configuration, or of another JSON object, as `in_text` does texts."""
        if isinstance(value, Mapping):
            return {self.in_values(key): self.in_values(item) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.in_values(item) for item in value]
        return self.in_text(value) if isinstance(value, str) else value

    def names_of(self, file: Path) -> list[str]:
        """Return the published names of a file; a file that is named in two ways has two.

        Raises InputError for a file that is neither in the working folder nor in a folder that the
        configuration names.
        """
        path = Path(os.path.abspath(file))  # noqa: PTH100 (links are kept)
        if path.is_relative_to(self._folder):
            return [path.relative_to(self._folder).as_posix()]
        roots = [each.root for each in self._named if path.is_relative_to(each.path)]
        if not roots:  # a file that a named one needs, such as the calibration beside poses
            outer = [r for r in self._aliases if path.is_relative_to(r) and str(r) != r.anchor]
            roots = sorted(outer, key=lambda root: len(root.parts))[-1:]
        if not roots:
            raise InputError(
                f"{file}: not in the folder of the run, and not named in the configuration: move "
                "it to this folder and run again"
            )
        return [self._name(path, root) for root in dict.fromkeys(roots)]


def _numbered(number: int) -> str:
    return _ELSEWHERE if number == 1 else f"{_ELSEWHERE}_{number}"


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from (*_texts(key), *_texts(item))
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from _texts(item)
    elif isinstance(value, str):
        yield value

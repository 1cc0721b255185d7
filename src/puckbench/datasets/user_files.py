"""Sets of files that a user names: paths, folders and patterns, and names for their scenes."""

from __future__ import annotations

import glob
import logging
import os
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from puckbench.core.content import plain_name, plain_suffix
from puckbench.core.errors import InputError, naming
from puckbench.datasets.base import DataSet, found
from puckbench.datasets.scene import safe_name, unique_names
from puckbench.datasets.units import Units, check_units, unit_of

_LOG = logging.getLogger(__name__)


class FileSet(DataSet):
    """A data set of one file for each scene, wherever the files lie.

    Scenes are called after their files, with folders and suffixes where files of the same name need
    them, and grouped by folder.
    """

    suffixes: ClassVar[tuple[str, ...]]
    what: ClassVar[str]

    path: str | tuple[str, ...] | dict[str, str]
    """A file, a folder with all below it, a pattern (``data/*.las``), a list of such, or a table of
    names and files."""
    metres_per_unit: Units = 1.0
    """Length of the files' unit: a number, or a table of files and numbers (1 for the others)."""
    licence: str = ""
    """Licence noted with every scene."""
    credit: str = ""
    """Credit noted with every scene."""

    def names(self) -> list[str]:
        """Names of the scenes; lists folders, reads no scene."""
        return list(self._table)

    def files(self, name: str) -> list[Path]:
        """The scene's file."""
        return [self._file(name)]

    def options_of(self, name: str) -> dict[str, Any]:
        """Options of a set of this scene alone, which do not change with the other scenes."""
        path = self._file(name)
        options = self.model_dump(exclude_defaults=True) | {"path": {name: str(path)}}
        if "metres_per_unit" in options:
            options["metres_per_unit"] = self._unit(path)
        return options

    @abstractmethod
    def _takes(self, path: Path) -> bool:
        """Whether a file in a folder is one of the scenes, by what it begins with."""

    def _file(self, name: str) -> Path:
        return found(self._table, name, self.what)

    def _group(self, path: Path) -> str:
        return safe_name(path.resolve().parent.name)

    def _unit(self, path: Path) -> float:
        return unit_of(path, self.metres_per_unit)

    def _about(self, path: Path) -> dict[str, object]:
        unit = self._unit(path)
        about: dict[str, object] = {"source": path.name, "format": plain_suffix(path)[1:]}
        about |= {} if unit == 1 else {"metres_per_unit": unit}
        return {**about, "licence": self.licence, "credit": self.credit}

    @cached_property
    def _table(self) -> Mapping[str, Path]:
        table = self._listed()
        with naming("metres_per_unit"):
            check_units(self.metres_per_unit, table.values())
        return table

    def _listed(self) -> Mapping[str, Path]:
        if isinstance(self.path, dict):
            return {name: self._chosen(name, text) for name, text in self.path.items()}
        given = (self.path,) if isinstance(self.path, str) else self.path
        paths = [path for one in given for path in self._named(one)]
        if not paths:
            raise InputError(f"path: no {self.what} named")
        twice = [path for path, count in Counter(map(os.path.realpath, paths)).items() if count > 1]
        if twice:
            raise InputError(f"{Path(twice[0]).name}: the file is named twice")
        return dict(sorted(zip(scene_names(paths), paths, strict=True)))

    def _chosen(self, name: str, text: str) -> Path:
        """The file of a name that the user gave it."""
        if safe_name(name) != name:
            raise InputError(f"path: {name!r} is no name for a file ({safe_name(name)!r} is one)")
        path = Path(text)
        if not path.is_file():
            raise InputError(f"{text}: no such file")
        return path

    def _named(self, text: str) -> list[Path]:
        """The files that a path or pattern stands for."""
        path, known = Path(text), ", ".join(self.suffixes)
        if path.is_dir():
            inside = distinct(one for one in path.rglob("*") if self._is_of_set(one))
            if not inside:
                raise InputError(f"{text}: no {self.what} there ({known})")
            return inside
        if path.exists():
            if plain_suffix(path) not in self.suffixes:
                raise InputError(f"{text}: not one of the {self.what} by its name ({known})")
            return [path]
        matches = map(Path, glob.glob(text, recursive=True))  # noqa: PTH207 (any pattern)
        inside = distinct(one for one in matches if self._is_of_set(one))
        if not inside:
            raise InputError(f"{text}: no such file")
        return inside

    def _is_of_set(self, path: Path) -> bool:
        is_known = plain_suffix(path) in self.suffixes and not path.name.startswith(".")
        return is_known and is_file_or_lost(path) and self._takes(path)


def is_file_or_lost(path: Path) -> bool:
    """Whether a path is a file, or a link to one that is gone, which no run should overlook."""
    return path.is_file() or (path.is_symlink() and not path.exists())


def distinct(paths: Iterable[Path]) -> list[Path]:
    """The paths in order, without links to files that are among them."""
    files: dict[str, Path] = {}
    for path in sorted(paths, key=lambda path: (path.is_symlink(), path)):
        place = os.path.realpath(path)
        if place in files:
            _LOG.warning("%s: leads to %s, which is there too: left out", path, files[place])
        files.setdefault(place, path)
    return sorted(files.values())


def scene_names(paths: Iterable[Path]) -> list[str]:
    """Names for files: their stems; where two are alike, with folders or suffixes before them."""
    listed = list(paths)
    plain = {path: plain_name(path) for path in listed}
    stems = Counter(safe_name(plain[path].stem).lower() for path in listed)
    alike = [path for path in listed if stems[safe_name(plain[path].stem).lower()] > 1]
    folders = [str(path.resolve().parent) for path in alike]
    common = os.path.commonpath(folders) if alike else ""
    whole = {
        path: "-".join((*Path(folder).relative_to(common).parts, plain[path].stem))
        for path, folder in zip(alike, folders, strict=True)
    }
    counts = Counter(name.lower() for name in whole.values())
    return unique_names(
        plain[path].stem
        if path not in whole
        else f"{whole[path]}_{plain[path].suffix[1:]}"
        if counts[whole[path].lower()] > 1
        else whole[path]
        for path in listed
    )

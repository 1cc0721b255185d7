from __future__ import annotations

import glob
import logging
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from pydantic import PositiveFloat

from cloud_files.content import plain_name, plain_suffix
from pointkit.errors import InputError, closest, naming
from pointkit.files import refuse_special
from puckbench.scene_sets.base import SceneSet, look_up
from puckbench.scene_sets.scene import safe_name, unique_names

_LOG = logging.getLogger(__name__)

TIMES_FILE = "times.txt"
BESIDE_FRAMES = (TIMES_FILE, "poses.txt")
"""Names of files, in a folder of frames, that are no clouds though their suffix is that of some."""

Units = PositiveFloat | dict[str, PositiveFloat]
"""Metres per unit: one number for all files, or numbers by file name. Files without a number are
in metres."""


class FileSet(SceneSet):
    """Base class of scene sets in which each scene is one of the user's files.

    Scenes are grouped by folder and named after their files. Equal names are distinguished by
    folder or suffix.
    """

    suffixes: ClassVar[tuple[str, ...]]
    what: ClassVar[str]

    path: str | tuple[str, ...] | dict[str, str]
    """A file, a folder (with subfolders), a pattern (``data/*.las``), a list of these, or files by
    name."""
    metres_per_unit: Units = 1.0
    """Length of the files' unit, in m: a number, or numbers by file (1 for other files)."""
    licence: str = ""
    """Licence noted with every scene."""
    credit: str = ""
    """Credit noted with every scene."""

    def names(self) -> list[str]:
        return list(self._table)

    def files(self, name: str) -> list[Path]:
        return [self.file_of(name)]

    def options_of(self, name: str) -> dict[str, Any]:
        path = self.file_of(name)
        options = self.model_dump(exclude_defaults=True) | {"path": {name: str(path)}}
        if "metres_per_unit" in options:
            options["metres_per_unit"] = self.unit_of(path)
        return options

    def takes(self, path: Path) -> bool:
        """Return whether a file contains a scene of this set.

        `path` is a file with one of the set's `suffixes`. By default the result is true. A subclass
        may override this, for example to read the first bytes of the file.
        """
        return True

    def file_of(self, name: str) -> Path:
        """Return the path of a scene; raise InputError for unknown names."""
        return look_up(self._table, name, self.what)

    def group_of(self, path: Path) -> str:
        """Return the group of a file's scene: by default, the name of its folder."""
        return safe_name(path.parent.name.strip(".") or "files")  # not of the working folder

    def unit_of(self, path: Path) -> float:
        """Return the length of a file's unit, m."""
        return _unit_of(path, self.metres_per_unit)

    def about(self, path: Path) -> dict[str, object]:
        """Return a description of a file's scene: its source, format, unit, licence and credit."""
        unit = self.unit_of(path)
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
            return {name: self._named_file(name, text) for name, text in self.path.items()}
        texts = (self.path,) if isinstance(self.path, str) else self.path
        paths = [path for text in texts for path in self._files_at(text)]
        if not paths:
            raise InputError(f"path: no {self.what} named")
        refuse_repeated(paths, "file")
        return dict(sorted(zip(scene_names(paths), paths, strict=True)))

    def _named_file(self, name: str, text: str) -> Path:
        if safe_name(name) != name:
            raise InputError(f"path: {name!r} is not a valid file name; use {safe_name(name)!r}")
        path = Path(text)
        refuse_special(path)
        if not path.is_file():
            raise InputError(f"{text}: no such file")
        return path

    def _files_at(self, text: str) -> list[Path]:
        path, suffixes = Path(text), self.suffixes
        if path.is_file() and plain_suffix(path) not in suffixes:
            raise InputError(f"{text}: not one of the {self.what}: expected {', '.join(suffixes)}")
        return paths_at(text, lambda at: at.rglob("*"), self._is_of_set, self.what, suffixes)

    def _is_of_set(self, path: Path) -> bool:
        is_named_so = plain_suffix(path) in self.suffixes and path.name not in BESIDE_FRAMES
        is_shown = not path.name.startswith(".")
        return is_named_so and is_shown and is_file_or_lost(path) and self.takes(path)


def is_named(path: Path, name: str) -> bool:
    """Return whether a path ends with the parts of a name, such as ``folder/file.ply``."""
    parts = Path(name).parts
    return bool(parts) and path.parts[-len(parts) :] == parts


def _unit_of(path: Path, units: float | Mapping[str, float]) -> float:
    """Return the length of a file's unit in m.

    Parameters
    ----------
    path
        The file.
    units
        One length for all files, or lengths by file name. Files without a length are in metres.
    """
    if not isinstance(units, Mapping):
        return units
    return next((unit for name, unit in units.items() if is_named(path, name)), 1.0)


def check_units(units: float | Mapping[str, float], paths: Iterable[Path]) -> None:
    """Raise InputError if units are given for a file that is not there.

    Parameters
    ----------
    units
        One length for all files, or lengths (m) by file name.
    paths
        Paths of the files that are there.
    """
    files = list(paths)
    for name in units if isinstance(units, Mapping) else ():
        if not any(is_named(path, name) for path in files):
            near = closest(name, [path.name for path in files])
            raise InputError(f"no cloud or mesh '{name}'{near}")


def paths_at(
    text: str,
    below: Callable[[Path], Iterable[Path]],
    is_accepted: Callable[[Path], bool],
    what: str,
    suffixes: Iterable[str],
) -> list[Path]:
    """Return the paths of the files that a text names.

    Parameters
    ----------
    text
        A path, a folder, or a pattern such as ``data/*.las``.
    below
        Function that yields the paths below a folder.
    is_accepted
        Function that tells which paths in a folder or of a pattern to return.
    what
        Name of the files in messages, such as "recordings".
    suffixes
        Suffixes of the files in messages.

    Raises
    ------
    InputError
        There are no paths.
    """
    path = Path(text)
    if path.is_dir() and not is_accepted(path):
        paths = without_duplicates(filter(is_accepted, below(path)))
        if not paths:
            raise InputError(f"{text}: no {what} ({', '.join(suffixes)})")
        return paths
    if path.exists():
        return [path]
    matches = map(Path, glob.glob(text, recursive=True))  # noqa: PTH207 (any pattern)
    paths = without_duplicates(filter(is_accepted, matches))
    if not paths:
        raise InputError(f"{text}: no such file or folder (expected {what})")
    return paths


def refuse_repeated(paths: Iterable[Path], what: str) -> None:
    counts = Counter(map(os.path.realpath, paths))
    if repeated := [path for path, count in counts.items() if count > 1]:
        raise InputError(f"{Path(repeated[0]).name}: the {what} is named twice")


def is_file_or_lost(path: Path) -> bool:
    return path.is_file() or (path.is_symlink() and not path.exists())


def without_duplicates(paths: Iterable[Path]) -> list[Path]:
    """Return the paths, sorted, without links to files that are listed already."""
    files: dict[str, Path] = {}
    for path in sorted(paths, key=lambda path: (path.is_symlink(), path)):
        place = os.path.realpath(path)
        if place in files:
            _LOG.warning("%s: left out, because it links to %s", path, files[place])
        files.setdefault(place, path)
    return sorted(files.values())


def scene_names(paths: Iterable[Path]) -> list[str]:
    """Return unique names of scenes for files, in the order of the paths.

    A name is that of the file without suffix. Equal names are distinguished by folder or suffix.
    """
    listed = list(paths)
    plain = {path: plain_name(path) for path in listed}
    stems = Counter(safe_name(plain[path].stem).lower() for path in listed)
    alike = [path for path in listed if stems[safe_name(plain[path].stem).lower()] > 1]
    folders = [os.path.abspath(path.parent) for path in alike]  # noqa: PTH100 (links are kept)
    common = os.path.commonpath(folders) if alike else ""
    names = {path: plain[path].stem for path in listed}
    for path, folder in zip(alike, folders, strict=True):
        names[path] = "-".join((*Path(folder).relative_to(common).parts, plain[path].stem))
    counts = Counter(names[path].lower() for path in alike)
    for path in alike:
        if counts[names[path].lower()] > 1:
            names[path] += f"_{plain[path].suffix[1:]}"
    return unique_names(names[path] for path in listed)

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import PositiveFloat

from pointkit.errors import InputError, closest

Units = PositiveFloat | dict[str, PositiveFloat]
"""Metres per unit: one number for all files, or numbers by file name. Files without a number are
in metres."""


def is_named(path: Path, name: str) -> bool:
    """Return whether a path ends with the parts of a name, such as ``folder/file.ply``."""
    parts = Path(name).parts
    return bool(parts) and path.parts[-len(parts) :] == parts


def metres_per_unit_of(path: Path, units: float | Mapping[str, float]) -> float:
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
    """Raise InputError if `units` names a file that is not among the paths."""
    files = list(paths)
    for name in units if isinstance(units, Mapping) else ():
        if not any(is_named(path, name) for path in files):
            near = closest(name, [path.name for path in files])
            raise InputError(f"no cloud or mesh '{name}'{near}")

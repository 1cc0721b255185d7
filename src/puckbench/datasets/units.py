from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import PositiveFloat

from pointkit.errors import InputError, closest

Units = PositiveFloat | dict[str, PositiveFloat]
"""Metres per unit, of all files or by file name; files without a value are in metres."""


def is_named(path: Path, name: str) -> bool:
    """Return whether a path ends with the parts of a name, such as ``folder/file.ply``."""
    parts = Path(name).parts
    return bool(parts) and path.parts[-len(parts) :] == parts


def metres_per_unit_of(path: Path, units: float | Mapping[str, float]) -> float:
    if not isinstance(units, Mapping):
        return units
    return next((unit for name, unit in units.items() if is_named(path, name)), 1.0)


def check_units(units: float | Mapping[str, float], paths: Iterable[Path]) -> None:
    files = list(paths)
    for name in units if isinstance(units, Mapping) else ():
        if not any(is_named(path, name) for path in files):
            near = closest(name, [path.name for path in files])
            raise InputError(f"no cloud or mesh '{name}'{near}")

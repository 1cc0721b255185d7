"""Keys of a configuration that have new names; their old names are still read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pointkit.errors import InputError

_OLD = "scenes"
_OF_RUN = "scene_sets"
"""New name of the key that lists scene sets."""
_OF_ENTRY = "scene_set"
"""New name of the key of a data set or drive that names its scene set."""
_ENTRIES = ("datasets", "drives")


def with_new_keys(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a configuration in which every key has its present name.

    Parameters
    ----------
    configuration
        Keys and values of a configuration, not yet checked. Values of a wrong type stay as they
        are.

    Raises
    ------
    InputError
        A key is there by both its old and its new name.
    """
    renamed = _renamed(configuration, _OF_RUN, "the configuration")
    for kind in _ENTRIES:
        if isinstance(entries := renamed.get(kind), Mapping):
            renamed[kind] = {
                name: _renamed_entry(entry, f"{kind}.{name}") for name, entry in entries.items()
            }
    return renamed


def renaming_line(configuration: Mapping[str, Any]) -> str:
    """Return a line that tells the new names of a configuration's old keys; empty if none is old.

    Raises
    ------
    InputError
        A key is there by both its old and its new name.
    """
    renamed = with_new_keys(configuration)
    lines = [f"'{_OLD}' is now '{_OF_RUN}'"] if _OLD in configuration else []
    if any(renamed.get(kind) != configuration.get(kind) for kind in _ENTRIES):
        lines.append(f"'{_OLD}' of a data set or drive is now '{_OF_ENTRY}'")
    return f"configuration: {'; '.join(lines)}" if lines else ""


def _renamed_entry(entry: Any, place: str) -> Any:
    if not isinstance(entry, Mapping):
        return entry
    renamed = _renamed(entry, _OF_ENTRY, place)
    if isinstance(stand_in := renamed.get("stand_in"), Mapping):
        renamed["stand_in"] = _renamed(stand_in, _OF_ENTRY, f"{place}.stand_in")
    return renamed


def _renamed(values: Mapping[str, Any], new: str, place: str) -> dict[str, Any]:
    if _OLD in values and new in values:
        raise InputError(f"{place} has '{_OLD}' and '{new}', which is its new name: keep one")
    return {new if key == _OLD else key: value for key, value in values.items()}

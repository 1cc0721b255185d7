"""Descriptions: JSON files that are written beside clouds, meshes and tables of returns."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from cloud_files.content import plain_name
from pointkit.errors import InputError
from pointkit.files import read_json, write_json

Kind = Literal["cloud", "mesh", "returns"]

_KIND_KEY = "puckbench"
"""Key of the described file's kind, by which a description is told from other JSON files."""
_log = logging.getLogger(__name__)


def sidecar(path: Path) -> Path:
    """Return the path of a file's description: ``a.json`` for ``a.ply`` and ``a.ply.gz``."""
    return plain_name(path).with_suffix(".json")


def write_description(path: Path, kind: Kind, about: Mapping[str, Any]) -> None:
    """Write the JSON description beside a file.

    Parameters
    ----------
    path
        The described file; the description has the same name with the suffix ``.json``.
    kind
        What the file is.
    about
        Entries of the description, with values that JSON can represent.
    """
    write_json(sidecar(path), {**about, _KIND_KEY: kind})


def read_description(path: Path, counts: Mapping[str, int] | None = None) -> dict[str, Any] | None:
    """Read the JSON description beside a file.

    Parameters
    ----------
    path
        The described file.
    counts
        Numbers that the file holds, by their names in the description (such as ``points``).

    Returns
    -------
    dict or None
        The description; None if the file has none. A JSON file of another program and a description
        that contradicts `counts` are ignored with a warning.
    """
    beside = sidecar(path)
    if beside == path or not beside.exists():
        return None
    try:
        about = read_json(beside)
    except InputError:
        about = None
    if not isinstance(about, dict) or _KIND_KEY not in about:
        _log.warning("%s: %s beside it is not its description: not used", path, beside.name)
        return None
    for name, count in (counts or {}).items():
        if about.get(name, count) != count:
            mismatch = f"{beside.name} beside it describes a file of {about[name]} {name}"
            _log.warning("%s: %d %s, but %s: not used", path, count, name, mismatch)
            return None
    return {name: value for name, value in about.items() if name != _KIND_KEY}

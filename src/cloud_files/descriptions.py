"""Descriptions: a JSON file beside each cloud, mesh or table of returns that has been written."""

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
    """Write the description of the file `path`: what it is, and values that JSON can represent."""
    write_json(sidecar(path), {**about, _KIND_KEY: kind})


def read_description(path: Path, counts: Mapping[str, int] | None = None) -> dict[str, Any] | None:
    """Read the description beside a file.

    Parameters
    ----------
    path
        The described file.
    counts
        Numbers that the file holds, by the names under which its description has them (such as
        ``points``).

    Returns
    -------
    dict or None
        The description; None if there is none. A JSON file of another program, or a description
        that contradicts `counts`, is not used either, which is logged as a warning.
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

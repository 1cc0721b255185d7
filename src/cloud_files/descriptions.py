"""Descriptions: JSON files beside the clouds, meshes and tables that puckbench writes."""

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
"""Key of the described file's kind; only descriptions by puckbench have this key."""
_log = logging.getLogger(__name__)


def sidecar(path: Path) -> Path:
    return plain_name(path).with_suffix(".json")


def write_description(path: Path, kind: Kind, about: Mapping[str, Any]) -> None:
    write_json(sidecar(path), {**about, _KIND_KEY: kind})


def read_description(path: Path, counts: Mapping[str, int] | None = None) -> dict[str, Any] | None:
    """Read the description (JSON) beside a file; return None if there is none.

    Another program's JSON file, or a description that contradicts `counts` (such as ``points``), is
    ignored with a warning.
    """
    beside = sidecar(path)
    if beside == path or not beside.exists():
        return None
    about = _read_if_of_puckbench(beside)
    if about is None:
        _log.warning("%s: %s beside it is not its description: not used", path, beside.name)
        return None
    for name, count in (counts or {}).items():
        if about.get(name, count) != count:
            mismatch = f"{beside.name} beside it describes a file of {about[name]} {name}"
            _log.warning("%s: %d %s, but %s: not used", path, count, name, mismatch)
            return None
    return {name: value for name, value in about.items() if name != _KIND_KEY}


def _read_if_of_puckbench(path: Path) -> dict[str, Any] | None:
    try:
        about = read_json(path)
    except InputError:
        return None
    return about if isinstance(about, dict) and _KIND_KEY in about else None

"""The descriptions (JSON) beside the files that puckbench writes."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from puckbench.core.content import plain_name
from puckbench.core.errors import InputError
from puckbench.core.files import read_json, write_json

Kind = Literal["cloud", "mesh", "returns"]

_MARK = "puckbench"
"""Key that only our descriptions have: what kind of file they describe."""
_log = logging.getLogger(__name__)


def sidecar(path: Path) -> Path:
    """The JSON file that describes the artefact at `path`."""
    return plain_name(path).with_suffix(".json")


def write_description(path: Path, kind: Kind, about: Mapping[str, Any]) -> None:
    """Write the description of the file at `path`, beside it."""
    write_json(sidecar(path), {**about, _MARK: kind})


def read_description(path: Path, counts: Mapping[str, int] | None = None) -> dict[str, Any] | None:
    """Read the description beside a file, if puckbench wrote it for this file; else None.

    A JSON file of another program, and a description of other counts than `counts`, is left aside
    with a remark.
    """
    beside = sidecar(path)
    if beside == path or not beside.exists():
        return None
    about = _ours(beside)
    if about is None:
        _log.warning("%s: %s beside it is not its description: not used", path, beside.name)
        return None
    for name, count in (counts or {}).items():
        if about.get(name, count) != count:
            told = f"{beside.name} beside it describes a file of {about[name]} {name}"
            _log.warning("%s: %d %s, but %s: not used", path, count, name, told)
            return None
    return {name: value for name, value in about.items() if name != _MARK}


def _ours(path: Path) -> dict[str, Any] | None:
    """The content of a JSON file that is a description of ours."""
    try:
        about = read_json(path)
    except InputError:
        return None
    is_ours = isinstance(about, dict) and (_MARK in about or _is_of_first_version(about))
    return about if is_ours else None


def _is_of_first_version(about: Mapping[str, Any]) -> bool:
    """Whether it has the keys of our descriptions before they were marked."""
    counts = {name for name in ("points", "vertices", "triangles") if type(about.get(name)) is int}
    return counts >= {"vertices", "triangles"} or ("points" in counts and "source" in about)

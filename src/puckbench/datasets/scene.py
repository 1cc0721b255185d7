"""A scene (a mesh or a cloud, and where it comes from) and what every set of scenes offers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeVar

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Mesh

T = TypeVar("T")


@dataclass(frozen=True)
class Scene:
    """One scene in metres with z up.

    name: file-name safe and unique in its set. group: its class, room type or area. Exactly one
    of mesh and cloud is given. origin: where a sensor may stand, if known. box: (2, 3) the
    room's box, to crop to; None stands for the bounds of the mesh. about: licence, credit,
    source and counts of what was repaired or skipped.
    """

    name: str
    group: str
    mesh: Mesh | None = None
    cloud: PointCloud | None = None
    origin: tuple[float, float, float] | None = None
    box: Floats | None = None
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (self.mesh is None) == (self.cloud is None):
            raise ValueError(f"scene {self.name}: needs a mesh or a cloud, not both")


class SceneSet(Protocol):
    """One class per data set, constructed with keyword options from the configuration.

    A set whose meshes have the geometric primitive of each triangle in their labels says so by a
    class variable ``primitives = True``; see `has_primitives`.
    """

    def names(self) -> list[str]:
        """Names of the scenes, sorted; InputError tells what is missing and where it should lie."""

    def files(self, name: str) -> list[Path]:
        """Files that the scene is read from; none for generated scenes."""

    def load(self, name: str) -> Scene:
        """The scene; InputError when it is unknown or its files are damaged."""


def has_primitives(scenes: SceneSet) -> bool:
    """Whether the meshes of a set are labelled with the geometric primitives they are made of."""
    return bool(getattr(scenes, "primitives", False))


def safe_name(text: str) -> str:
    """`text` with everything that does not belong into a file name replaced by underscores."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", text).strip("._") or "unnamed"


def unique_names(texts: Iterable[str]) -> list[str]:
    """File-name safe names, in order; one taken already (whatever its case) gets a number."""
    taken: set[str] = set()
    names = []
    for text in texts:
        base = name = safe_name(text)
        number = 2
        while name.lower() in taken:
            name, number = f"{base}_{number}", number + 1
        taken.add(name.lower())
        names.append(name)
    return names


def existing_folder(path: str, what: str) -> Path:
    """The folder at `path`; InputError, which says `what` should lie there, when it is missing."""
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(f"{path}: no such folder ({what} should lie there)")
    return folder


def found(table: Mapping[str, T], name: str, where: str) -> T:
    """The entry of `table` called `name`; InputError names the set and some of its scenes."""
    if name not in table:
        some = ", ".join(list(table)[:5])
        raise InputError(f"{where}: no scene '{name}' (it has {len(table)}: {some}, ...)")
    return table[name]

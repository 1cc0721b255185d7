"""A scene (a mesh, a cloud or a sensor's returns, and their source) and what data sets offer."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Mesh

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns


@dataclass(frozen=True)
class Scene:
    """One scene, in metres with z up: a mesh, a cloud, or a real sensor's returns.

    Parameters
    ----------
    name
        Safe as a file name and unique in its data set.
    group
        Its class, room type or area.
    mesh, cloud, returns
        Exactly one of them is given.
    origin
        (x, y, z) where a sensor may stand, if known.
    box
        (2, 3) lowest and highest corner of the room, to crop to; None for the bounds of the mesh.
    about
        Source, licence, credit, and counts of what was repaired or skipped.
    """

    name: str
    group: str
    mesh: Mesh | None = None
    cloud: PointCloud | None = None
    returns: Returns | None = None
    origin: tuple[float, float, float] | None = None
    box: Floats | None = None
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if sum(one is not None for one in (self.mesh, self.cloud, self.returns)) != 1:
            raise ValueError(f"scene {self.name}: needs one of a mesh, a cloud and returns")


class SceneSet(Protocol):
    """What a data set offers; its constructor takes the options of the configuration by name.

    A data set whose meshes name the geometric primitive of each triangle in their labels says so by
    a class variable ``primitives = True``; one of clouds, or of meshes, alone by ``of_clouds``, and
    one whose clouds are a sensor's returns by ``of_returns`` as well, and by ``of_packets`` where
    these are those of data packets; ``read_first`` has its clouds read before a run. A method
    ``options_of(name)`` may give the options of a set of one scene, so that it is not made again
    when others come and go.
    """

    def __init__(self, **options: Any) -> None: ...

    def names(self) -> list[str]:
        """Names of the scenes, sorted; InputError tells what is missing and where it should lie."""

    def files(self, name: str) -> list[Path]:
        """Files that the scene is read from; none for generated scenes."""

    def load(self, name: str) -> Scene:
        """The scene; InputError when it is unknown or its files are damaged."""


def has_primitives(scenes: SceneSet) -> bool:
    """Whether the labels of a data set's meshes name the geometric primitives of the triangles."""
    return bool(getattr(scenes, "primitives", False))


def of_clouds(scenes: SceneSet) -> bool | None:
    """Whether the scenes of a data set are clouds, not meshes; None where it does not say."""
    found: bool | None = getattr(scenes, "of_clouds", None)
    return found


def of_returns(scenes: SceneSet) -> bool:
    """Whether the scenes of a data set are a real sensor's returns."""
    return bool(getattr(scenes, "of_returns", False))


def of_packets(scenes: SceneSet) -> bool:
    """Whether the returns of a data set's scenes are those of a recording's data packets."""
    return bool(getattr(scenes, "of_packets", False))


def read_first(scenes: SceneSet) -> bool:
    """Whether the clouds of a data set are read before a run, to leave out those not usable."""
    return bool(getattr(scenes, "read_first", False))


def safe_name(text: str) -> str:
    """The text with underscores for all that is not safe in a file name."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", text).strip("._") or "unnamed"


def unique_names(texts: Iterable[str]) -> list[str]:
    """The texts as distinct file names, whatever the case: one that is taken gets a number."""
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

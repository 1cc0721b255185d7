from __future__ import annotations

import re
import unicodedata
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
    """A scene, in metres with z up: a mesh, a cloud, or the returns of a real sensor.

    Parameters
    ----------
    name
        Valid as a file name and unique in its data set.
    group
        Class, room type or area.
    mesh, cloud, returns
        Exactly one is set.
    origin
        Possible position of a sensor, m.
    box
        Lowest and highest corner for cropping, (2, 3), m; None: the mesh's bounds.
    about
        Source, licence, credit, and the reader's report.
    pose
        Transform from the frame of the cloud or returns to the world, (4, 4), m.
    time_s
        Time of the cloud or returns, s.
    """

    name: str
    group: str
    mesh: Mesh | None = None
    cloud: PointCloud | None = None
    returns: Returns | None = None
    origin: tuple[float, float, float] | None = None
    box: Floats | None = None
    about: dict[str, Any] = field(default_factory=dict)
    pose: Floats | None = None
    time_s: float | None = None

    def __post_init__(self) -> None:
        if sum(source is not None for source in (self.mesh, self.cloud, self.returns)) != 1:
            raise ValueError(f"scene {self.name}: needs one of a mesh, a cloud and returns")


class SceneSet(Protocol):
    """Interface of data sets, whose constructors take options by name.

    Optional class variables: ``primitives``, whether labels have each triangle's geometric
    primitive; ``of_clouds``, whether scenes are clouds instead of meshes; ``of_returns``, whether
    clouds are a sensor's returns; ``of_packets``, whether returns come from recorded data packets;
    ``read_first``, whether clouds are read before a run. An optional method ``options_of(name)``
    returns the options of a set with one scene, whose jobs then do not depend on other scenes.
    """

    def __init__(self, **options: Any) -> None: ...

    def names(self) -> list[str]:
        """Return the sorted names of the scenes; raise InputError if files are missing."""

    def files(self, name: str) -> list[Path]:
        """Return the files from which a scene is read; none for generated scenes."""

    def load(self, name: str) -> Scene:
        """Return a scene; raise InputError if it is unknown or damaged."""


def has_primitives(scenes: SceneSet) -> bool:
    return bool(getattr(scenes, "primitives", False))


def of_clouds(scenes: SceneSet) -> bool | None:
    """Return whether scenes are clouds instead of meshes; None if the class lacks ``of_clouds``."""
    declared: bool | None = getattr(scenes, "of_clouds", None)
    return declared


def of_returns(scenes: SceneSet) -> bool:
    return bool(getattr(scenes, "of_returns", False))


def of_packets(scenes: SceneSet) -> bool:
    return bool(getattr(scenes, "of_packets", False))


def read_first(scenes: SceneSet) -> bool:
    return bool(getattr(scenes, "read_first", False))


def safe_name(text: str) -> str:
    """Convert a text to an ASCII file name; remove accents, replace unsuitable characters by _."""
    letters = unicodedata.normalize("NFKD", text).replace("ß", "ss")
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).strip("._") or "unnamed"


def unique_names(texts: Iterable[str]) -> list[str]:
    """Convert texts to file names that are unique ignoring case; repeated names get numbers."""
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

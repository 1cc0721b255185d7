from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.geometry.mesh import Mesh

if TYPE_CHECKING:
    from pointkit.lidar.returns import Returns


@dataclass(frozen=True)
class Scene:
    """A scene that is scanned or encoded, in metres with z up.

    It is a mesh, a cloud, or the returns (range measurements) of a real sensor.

    Parameters
    ----------
    name
        Name, valid as a file name and unique in the data set.
    group
        Class, room type or area.
    mesh, cloud, returns
        The content. Exactly one of them is set.
    origin
        Possible position of a sensor, in m.
    box
        Lowest and highest corner for cropping, (2, 3), in m. None stands for the mesh's bounds.
    about
        Source, licence, credit, and what the reader reports.
    pose
        Transform (4, 4) from the coordinate frame of the cloud or returns to the world, in m.
    time_s
        Time of the cloud or returns, in s.
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


_MOST_LETTERS = 128
"""With this limit, the names of temporary files have at most 255 bytes."""


def safe_name(text: str) -> str:
    """Convert a text to an ASCII file name.

    Accents are removed, and unsuitable characters replaced by underscores. The name is shortened to
    128 characters. If its end repeats 20 times, which Snakemake refuses as a wildcard, the end is
    kept only one time. An empty name becomes "unnamed".
    """
    letters = unicodedata.normalize("NFKD", text).replace("ß", "ss")
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain)[:_MOST_LETTERS]
    return re.sub(r"(.+?)\1{19,}$", r"\1", name).strip("._") or "unnamed"


def unique_names(texts: Iterable[str]) -> list[str]:
    """Convert texts to file names that differ in more than upper and lower case.

    Repeated names get numbers. The result has the order of the texts.
    """
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

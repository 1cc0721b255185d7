"""A generated building of 272 rooms in six areas, named and counted as those of S3DIS."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from puckbench.datasets.embedded import ABOUT, check_detail, chosen
from puckbench.datasets.scene import Scene, found
from puckbench.scenes.building import AREAS, room_types
from puckbench.scenes.rooms import make_room, origin, room_box


@dataclass(frozen=True)
class EmbeddedAreas:
    """Furnished rooms that stand in for those of S3DIS, each different, grouped by type.

    seed: what shapes and furnishing are drawn from. areas: names of areas (Area_1, ...), or how
    many of the first; all six by default. rooms: at most so many of each area. detail: factor on
    the tessellation of curved parts. Scenes are called Area_1_office_1.
    """

    seed: int = 0
    areas: tuple[str, ...] | int | None = None
    rooms: int | None = None
    detail: float = 1.0

    def __post_init__(self) -> None:
        check_detail(self.detail)

    def names(self) -> list[str]:
        """Area, type and number of every room kept."""
        kept = chosen("areas", self.areas, list(AREAS))
        return sorted(name for area in kept for name in _rooms_of(area)[: self.rooms])

    def files(self, name: str) -> list[Path]:
        """None: the room is generated."""
        return []

    def load(self, name: str) -> Scene:
        """Make the room; its box lies between its walls, floor and ceiling."""
        kind = found(room_types(), name, "the generated building")
        mesh = make_room(name, self.seed, self.detail)
        about: dict[str, Any] = {**ABOUT, "seed": self.seed, "detail": self.detail}
        place, box = origin(name, self.seed), room_box(name, self.seed)
        return Scene(name, kind, mesh=mesh, origin=place, box=box, about=about)


def _rooms_of(area: str) -> list[str]:
    return [name for name in room_types() if name.startswith(f"{area}_")]

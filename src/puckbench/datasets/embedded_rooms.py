"""Furnished rooms that puckbench generates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from puckbench.datasets.embedded import ABOUT, check_detail, chosen
from puckbench.datasets.scene import Scene
from puckbench.datasets.sweethome3d import SweetHome3D
from puckbench.geometry.mesh import Mesh
from puckbench.scenes.room_table import ROOMS
from puckbench.scenes.rooms import make_room, origin, room_box


@dataclass(frozen=True)
class EmbeddedRooms:
    """Furnished rooms, grouped by type.

    seed: what the furnishing is drawn from. rooms: names to keep, or how many of the first; all
    by default. detail: factor on the tessellation of curved parts. furniture: a folder of Sweet
    Home 3D's catalogues whose chairs, tables, sofas and bookcases replace the generated ones.
    """

    primitives: ClassVar[bool] = True

    seed: int = 0
    rooms: tuple[str, ...] | int | None = None
    detail: float = 1.0
    furniture: str | None = None

    def __post_init__(self) -> None:
        check_detail(self.detail)

    def names(self) -> list[str]:
        """Names of the rooms kept."""
        return sorted(chosen("rooms", self.rooms, list(ROOMS)))

    def files(self, name: str) -> list[Path]:
        """The catalogues, where real furniture is used."""
        return self._models.catalogues() if self._models else []

    def load(self, name: str) -> Scene:
        """Make the room; its box lies between its walls, floor and ceiling."""
        mesh = make_room(name, self.seed, self.detail, self._meshes)
        about: dict[str, Any] = {**ABOUT, "seed": self.seed, "detail": self.detail}
        if self._models:
            about["credit"] = self._models.credit()
        return Scene(
            name,
            ROOMS[name].kind,
            mesh=mesh,
            origin=origin(name, self.seed),
            box=room_box(name, self.seed),
            about=about,
        )

    @cached_property
    def _models(self) -> SweetHome3D | None:
        return None if self.furniture is None else SweetHome3D(self.furniture)

    @cached_property
    def _meshes(self) -> dict[str, list[Mesh]]:
        return self._models.furniture() if self._models else {}

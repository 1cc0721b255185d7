from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import ClassVar

from pydantic import PositiveFloat

from puckbench.datasets.base import GeneratedSet, select_names
from puckbench.datasets.registry import LOADERS
from puckbench.datasets.scene import Scene
from puckbench.datasets.sweethome3d import SweetHome3D
from puckbench.geometry.mesh import Mesh


@LOADERS.register("embedded_rooms")
class EmbeddedRooms(GeneratedSet):
    primitives: ClassVar[bool] = True

    seed: int = 0
    """Seed of the furnishing."""
    rooms: tuple[str, ...] | int | None = None
    """Names of rooms, or the number of first rooms; all by default."""
    detail: PositiveFloat = 1.0
    """Factor of the number of triangles around curved parts."""
    furniture: str | None = None
    """Folder of Sweet Home 3D's catalogues, whose chairs, tables, sofas and bookcases replace the
    generated ones."""

    def names(self) -> list[str]:
        from puckbench.scenes.room_catalogue import ROOMS

        return sorted(select_names("rooms", self.rooms, list(ROOMS)))

    def files(self, name: str) -> list[Path]:
        return self._catalogues.catalogues() if self._catalogues else []

    def load(self, name: str) -> Scene:
        from puckbench.scenes.rooms import make_room, origin, room_box, room_spec

        credit = {"credit": self._catalogues.credit()} if self._catalogues else {}
        return Scene(
            name,
            room_spec(name).kind,
            mesh=make_room(name, self.seed, self.detail, self._meshes),
            origin=origin(name, self.seed),
            box=room_box(name, self.seed),
            about=self._about(seed=self.seed, detail=self.detail, **credit),
        )

    @cached_property
    def _catalogues(self) -> SweetHome3D | None:
        return None if self.furniture is None else SweetHome3D(path=self.furniture)

    @cached_property
    def _meshes(self) -> dict[str, list[Mesh]]:
        return self._catalogues.furniture() if self._catalogues else {}

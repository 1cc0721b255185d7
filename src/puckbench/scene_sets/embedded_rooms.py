from __future__ import annotations

from typing import ClassVar

from pydantic import PositiveFloat

from puckbench.scene_sets.base import GeneratedSet, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene

CODE = ("virtual_lidar.scenes.*",)


@LOADERS.register("embedded_rooms")
class EmbeddedRooms(GeneratedSet):
    primitives: ClassVar[bool] = True

    seed: int = 0
    """Seed of the furnishing."""
    rooms: tuple[str, ...] | int | None = None
    """Names of rooms, or n for the first n rooms; all by default."""
    detail: PositiveFloat = 1.0
    """Factor of the number of triangles around curved parts."""

    def names(self) -> list[str]:
        from virtual_lidar.scenes.rooms import ROOMS

        return sorted(select_names("rooms", self.rooms, list(ROOMS)))

    def load(self, name: str) -> Scene:
        from virtual_lidar.scenes.rooms import make_room, room_box, room_origin, room_spec

        mesh = make_room(name, self.seed, self.detail)
        place, box = room_origin(name, self.seed), room_box(name, self.seed)
        about = self.about(seed=self.seed, detail=self.detail)
        return Scene(name, room_spec(name).kind, mesh=mesh, origin=place, box=box, about=about)

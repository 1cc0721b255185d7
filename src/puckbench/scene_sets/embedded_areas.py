from __future__ import annotations

from pydantic import PositiveFloat, PositiveInt

from puckbench.scene_sets.base import GeneratedSet, look_up, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene

CODE = ("virtual_lidar.scenes.*",)


@LOADERS.register("embedded_areas")
class EmbeddedAreas(GeneratedSet):
    """The scenes are generated furnished rooms, as many of each type as S3DIS has.

    They are named Area_1_office_1 and grouped by room type.
    """

    seed: int = 0
    """Seed of shapes and furnishing."""
    areas: tuple[str, ...] | int | None = None
    """Names of areas (Area_1, ...), or n for the first n areas; all by default."""
    rooms: PositiveInt | None = None
    """Maximum number of rooms of each area."""
    detail: PositiveFloat = 1.0
    """Factor of the number of triangles around curved parts."""

    def names(self) -> list[str]:
        from virtual_lidar.scenes.rooms import AREAS

        kept = select_names("areas", self.areas, list(AREAS))
        return sorted(name for area in kept for name in _rooms_of(area)[: self.rooms])

    def load(self, name: str) -> Scene:
        from virtual_lidar.scenes.rooms import make_room, room_box, room_origin, room_types

        kind = look_up(room_types(), name, "the generated building")
        mesh = make_room(name, self.seed, self.detail)
        about = self.about(seed=self.seed, detail=self.detail)
        place, box = room_origin(name, self.seed), room_box(name, self.seed)
        return Scene(name, kind, mesh=mesh, origin=place, box=box, about=about)


def _rooms_of(area: str) -> list[str]:
    from virtual_lidar.scenes.rooms import room_types

    return [name for name in room_types() if name.startswith(f"{area}_")]

from __future__ import annotations

from typing import ClassVar

from pydantic import Field, PositiveInt

from puckbench.scene_sets.base import GeneratedSet, look_up
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene
from virtual_lidar.scenes.street import free_way, make_street, street_origin

CODE = ("virtual_lidar.scenes.*",)


@LOADERS.register("street")
class Street(GeneratedSet):
    """The scenes are generated streets with houses, trees, parked cars, and a free lane along x.

    They are named street_1, street_2, ... ``about["free_way_m"]`` is the lane's interval of x,
    relative to the scene's origin.
    """

    primitives: ClassVar[bool] = True

    seed: int = 0
    """Seed of houses, planting, fittings and cars."""
    streets: PositiveInt = 4
    """Number of streets (street_1, ...)."""
    length_m: float = Field(200.0, ge=40.0, le=1000.0)
    """Length of a street between the cross streets at its ends."""

    def names(self) -> list[str]:
        return sorted(f"street_{number}" for number in range(1, self.streets + 1))

    def load(self, name: str) -> Scene:
        name = look_up({street: street for street in self.names()}, name, "the generated streets")
        way = list(free_way(self.length_m))
        about = self.about(seed=self.seed, length_m=self.length_m, free_way_m=way)
        mesh = make_street(name, self.seed, self.length_m)
        return Scene(name, "street", mesh=mesh, origin=street_origin(), about=about)

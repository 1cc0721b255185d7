from __future__ import annotations

from typing import ClassVar

from pydantic import PositiveFloat

from puckbench.scene_sets.base import GeneratedSet, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene
from virtual_lidar.scenes.objects import CLASSES, MEMBERS, make_object

CODE = ("virtual_lidar.scenes.*",)


@LOADERS.register("embedded_objects")
class EmbeddedObjects(GeneratedSet):
    """The scenes are generated objects of 15 classes (airplane, ..., vase), 12 of each class.

    They are named chair_03 and grouped by class. The longest side is 1 m.
    """

    primitives: ClassVar[bool] = True

    seed: int = 0
    """Seed of the objects' shapes."""
    classes: tuple[str, ...] | int | None = None
    """Names of classes, or n for the first n classes; all by default."""
    members: int | None = None
    """Number of objects of each class, from 1 to 12; all by default."""
    detail: PositiveFloat = 1.0
    """Factor of the number of triangles around curved parts."""

    def names(self) -> list[str]:
        classes = select_names("classes", self.classes, list(CLASSES))
        numbers = select_names("members", self.members, [f"{k:02d}" for k in range(1, MEMBERS + 1)])
        return sorted(f"{name}_{number}" for name in classes for number in numbers)

    def load(self, name: str) -> Scene:
        mesh = make_object(name, self.seed, self.detail)
        about = self.about(seed=self.seed, detail=self.detail)
        return Scene(name, name.rpartition("_")[0], mesh=mesh, about=about)

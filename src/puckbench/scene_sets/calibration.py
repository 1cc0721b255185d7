from __future__ import annotations

from typing import ClassVar

from puckbench.scene_sets.base import GeneratedSet, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene
from virtual_lidar.scenes.calibration import CALIBRATIONS, calibration_origin, make_calibration

CODE = ("virtual_lidar.scenes.*",)


@LOADERS.register("calibration")
class CalibrationScenes(GeneratedSet):
    """The scenes are generated: a wall and a floor at several distances (thesis section 5.1)."""

    primitives: ClassVar[bool] = True

    scenes: tuple[str, ...] | None = None
    """Names of scenes (wall_floor_1m, ...); all by default."""

    def names(self) -> list[str]:
        return sorted(select_names("scenes", self.scenes, list(CALIBRATIONS)))

    def load(self, name: str) -> Scene:
        mesh, origin = make_calibration(name), calibration_origin(name)
        return Scene(name, "calibration", mesh=mesh, origin=origin, about=self.about())

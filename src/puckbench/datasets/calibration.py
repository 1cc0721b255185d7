"""Calibration scenes that puckbench generates: a wall and a floor at a distance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from puckbench.datasets.embedded import ABOUT, chosen
from puckbench.datasets.scene import Scene
from puckbench.scenes.calibration import CALIBRATIONS, calibration_origin, make_calibration


@dataclass(frozen=True)
class Calibration:
    """Wall and floor at a distance from the sensor (thesis section 5.1).

    scenes: names to keep (wall_floor_1m, ...); all by default.
    """

    primitives: ClassVar[bool] = True

    scenes: tuple[str, ...] | None = None

    def names(self) -> list[str]:
        """Names of the scenes kept."""
        return sorted(chosen("scenes", self.scenes, list(CALIBRATIONS)))

    def files(self, name: str) -> list[Path]:
        """None: the scene is generated."""
        return []

    def load(self, name: str) -> Scene:
        """Make the scene, with the sensor's place."""
        mesh, origin = make_calibration(name), calibration_origin(name)
        return Scene(name, "calibration", mesh=mesh, origin=origin, about=dict(ABOUT))

"""Objects of many classes that puckbench generates, in the spirit of CAPOD."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from puckbench.datasets.embedded import ABOUT, check_detail, chosen
from puckbench.datasets.scene import Scene
from puckbench.scenes.objects import CLASSES, MEMBERS, make_object


@dataclass(frozen=True)
class EmbeddedObjects:
    """Objects of 15 classes (airplane, ..., vase), 12 members each, grouped by class.

    seed: what the members' shapes are drawn from. classes: names to keep, or how many of the
    first; all by default. members: how many of each class. detail: factor on the tessellation of
    curved parts. Scenes are called chair_03; their longest side is 1.
    """

    primitives: ClassVar[bool] = True

    seed: int = 0
    classes: tuple[str, ...] | int | None = None
    members: int | None = None
    detail: float = 1.0

    def __post_init__(self) -> None:
        check_detail(self.detail)

    def names(self) -> list[str]:
        """Class and number of every object kept."""
        classes = chosen("classes", self.classes, list(CLASSES))
        numbers = chosen("members", self.members, [f"{k:02d}" for k in range(1, MEMBERS + 1)])
        return sorted(f"{name}_{number}" for name in classes for number in numbers)

    def files(self, name: str) -> list[Path]:
        """None: the object is generated."""
        return []

    def load(self, name: str) -> Scene:
        """Make the object."""
        mesh = make_object(name, self.seed, self.detail)
        about: dict[str, Any] = {**ABOUT, "seed": self.seed, "detail": self.detail}
        return Scene(name, name.rpartition("_")[0], mesh=mesh, about=about)

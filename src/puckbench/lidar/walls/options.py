"""How the residuals of a capture are measured: the sensor, the still interval, the planes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.lidar.options import check_above_zero, check_at_least, from_options
from puckbench.lidar.walls.detection import CEILING, FLOOR, WALL, PlaneSearch
from puckbench.lidar.walls.stillness import SHIFT_M

T = TypeVar("T")

WHAT = "capture options"
SURFACES = (WALL, FLOOR, CEILING)


@dataclass(frozen=True)
class Crop:
    """A plane chosen by hand: what it is, and the box (two corners, m, sensor's frame) to crop to.

    The box should leave out the surface's edges, where returns are mixed.
    """

    surface: str
    box: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if self.surface not in SURFACES:
            raise InputError(f"surface is {self.surface!r}, but must be one of {SURFACES}")
        if len(self.box) != 2 or any(len(corner) != 3 for corner in self.box):
            raise InputError("box must be two corners of three numbers, [[x, y, z], [x, y, z]]")
        if not np.all(np.less(*self.box)):
            raise InputError("each number of the box's first corner must be below the second's")

    def rows(self, points: Floats) -> NDArray[np.intp]:
        """Indices of the points (n, 3) in the box."""
        low, high = np.array(self.box)
        return np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))


@dataclass(frozen=True)
class CaptureOptions:
    """Options of a capture's residuals; all have defaults.

    sensor: name or YAML file (default: what the packets say). still_s: start and end of the
    interval that counts, in s after the first packet (default: the longest one in which the turns
    repeat its first within `most_shift_m`). most_turns: of it, the first ones. planes: those chosen
    by hand (default: found, as `search` says).
    """

    sensor: str | None = None
    still_s: tuple[float, ...] | None = None
    most_shift_m: float = SHIFT_M
    most_turns: int = 100
    planes: tuple[Crop, ...] = ()
    search: PlaneSearch = field(default_factory=PlaneSearch)

    def __post_init__(self) -> None:
        check_above_zero(self, "most_shift_m")
        check_at_least(self, 1, "most_turns")
        if self.still_s is not None and (
            len(self.still_s) != 2 or not 0 <= self.still_s[0] < self.still_s[1]
        ):
            raise InputError("still_s must be [start, end] in seconds, 0 or later, start first")


def capture_options(given: Mapping[str, Any]) -> CaptureOptions:
    """Options as JSON or YAML has them; InputError for an unknown one or a wrong value."""
    values = dict(given)
    if "planes" in values:
        values["planes"] = _crops(values["planes"])
    if "search" in values:
        values["search"] = _parts(PlaneSearch, values["search"], f"{WHAT}: search")
    return from_options(CaptureOptions, values, WHAT)


def _crops(given: Any) -> tuple[Crop, ...]:
    if not isinstance(given, (list, tuple)) or not given:
        raise InputError(f"{WHAT}: planes must be a list of at least one surface and box")
    return tuple(
        _parts(Crop, entry, f"{WHAT}: plane {number}") for number, entry in enumerate(given, 1)
    )


def _parts(kind: type[T], given: Any, what: str) -> T:
    if not isinstance(given, Mapping):
        raise InputError(f"{what} is {given!r}, but must be options by name")
    return from_options(kind, given, what)

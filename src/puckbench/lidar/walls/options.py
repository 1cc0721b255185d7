"""How the residuals of a recording are measured: the sensor, the still interval, the planes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from puckbench.core.errors import InputError
from puckbench.core.models import Model, parsed
from puckbench.geometry.cloud import Floats
from puckbench.lidar.walls.detection import PlaneSearch
from puckbench.lidar.walls.stillness import SHIFT_M


class Crop(Model):
    """A plane chosen by hand: what it is, and the box (two corners, m, sensor's frame) to crop to.

    The box should leave out the surface's edges, where returns are mixed.
    """

    surface: Literal["wall", "floor", "ceiling"]
    box: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _of_two_corners(self) -> Self:
        if len(self.box) != 2 or any(len(corner) != 3 for corner in self.box):
            raise InputError("box must be two corners of three numbers, [[x, y, z], [x, y, z]]")
        if not np.all(np.less(*self.box)):
            raise InputError("each number of the box's first corner must be below the second's")
        return self

    def rows(self, points: Floats) -> NDArray[np.intp]:
        """Indices of the points (n, 3) in the box."""
        low, high = np.array(self.box)
        return np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))


class CaptureOptions(Model):
    """Options of a recording's residuals; all have defaults.

    sensor: name or YAML file (default: what the packets say). still_s: start and end of the
    interval that counts, in s after the first packet (default: the longest one in which the turns
    repeat its first within `most_shift_m`). most_turns: of it, the first ones. planes: those chosen
    by hand (default: found, as `search` says).
    """

    sensor: str | None = None
    still_s: tuple[float, ...] | None = None
    most_shift_m: PositiveFloat = SHIFT_M
    most_turns: PositiveInt = 100
    planes: Annotated[tuple[Crop, ...], Field(min_length=1)] | None = None
    search: PlaneSearch = PlaneSearch()

    @model_validator(mode="after")
    def _of_an_interval(self) -> Self:
        if self.still_s is not None and (
            len(self.still_s) != 2 or not 0 <= self.still_s[0] < self.still_s[1]
        ):
            raise InputError("still_s must be [start, end] in seconds, 0 or later, start first")
        return self


def capture_options(given: Mapping[str, Any]) -> CaptureOptions:
    """Options as JSON or YAML has them; InputError for an unknown one or a wrong value."""
    return parsed(CaptureOptions, given, "capture options")

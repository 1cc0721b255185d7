"""Scaling to the cube [0, size - 1] as PCC Arena does, or to a grid; what brings back to metres."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

GRID = "grid"
"""In place of a size: the grid that a cloud came on, which its description tells."""
_OFF_GRID = 1e-3
"""Cells: what rounding to metres and back may move a point by, and much more."""


class Scaling(NamedTuple):
    """``scaled = (metres - offset) * scale``; offset (3,) in metres, scale in units per metre."""

    scale: float
    offset: Floats

    def apply(self, points: Floats) -> Floats:
        """Bring points (n, 3) from metres to the cube."""
        return (points - self.offset) * self.scale


def to_cube(points: Floats, size: int = 1024) -> Scaling:
    """The scaling that puts `points` (n, 3) into [0, size - 1] and keeps their aspect.

    The minimum of each axis is subtracted, then all axes are multiplied by (size - 1) over the
    largest remaining coordinate (thesis section 6.1.6). InputError for a cloud without extent.
    """
    offset = points.min(axis=0)
    extent = float((points.max(axis=0) - offset).max())
    if extent <= 0:
        raise InputError("the cloud has no extent: all its points are the same")
    return Scaling((size - 1) / extent, np.asarray(offset))


def to_grid(points: Floats, about: Mapping[str, Any]) -> Scaling:
    """The scaling that puts voxels in metres (n, 3) back on the whole numbers that they were.

    about: the cloud's description with ``grid``: ``metres`` of a cell, ``origin`` (3,) in metres of
    the first one, ``size`` in cells. InputError when there is none, or a point is not on it.
    """
    grid = about.get("grid")
    if grid is None:
        raise InputError("size grid: the cloud's description tells no grid that it came on")
    scaling = Scaling(1 / grid["metres"], np.asarray(grid["origin"], dtype=np.float64))
    cells = scaling.apply(points)
    off = int(np.count_nonzero((np.abs(cells - np.rint(cells)) > _OFF_GRID).any(axis=1)))
    if off:
        raise InputError(f"size grid: {off} of {len(points)} points are not on the cloud's grid")
    return scaling

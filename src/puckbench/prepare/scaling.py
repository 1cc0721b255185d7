"""Scaling to the cube [0, size - 1] as PCC Arena does, and what brings a cloud back to metres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.cloud import Floats
from puckbench.errors import InputError


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

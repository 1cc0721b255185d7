"""Scaling of a cloud to the cube [0, size - 1], as PCC Arena does, or to the grid it came on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, bounds

GRID = "grid"
"""In place of a size: the cloud's own voxel grid, from its description."""
METRIC = "metric"
"""In place of a size: metres in the frame that the cloud came in."""
FAR_M = 1000.0
"""Clouds in metres are shifted along an axis where all of their points lie beyond this."""
_OFF_GRID = 1e-3
"""Tolerance in voxels, far above the rounding of coordinates to metres and back."""


class Scaling(NamedTuple):
    """``scaled = (metres - offset) * scale``; offset (3,) in metres, scale in units per metre."""

    scale: float
    offset: Floats

    def apply(self, points: Floats) -> Floats:
        """Transform points (n, 3) from metres to the scaled frame."""
        return (points - self.offset) * self.scale


def origin_shift(points: Floats) -> Floats:
    """Whole metres (3,) to subtract from points (n, 3) of surveyed coordinates; 0 of near axes.

    Of each axis it is the whole part of the coordinate that is nearest to 0. A difference of that
    kind has no more binary digits than the coordinate itself: nothing is rounded, and adding the
    shift gives back every bit.
    """
    low, high = bounds(points)
    nearest = np.where(low > 0, low, np.where(high < 0, high, 0.0))
    return np.where(np.abs(nearest) > FAR_M, np.trunc(nearest), 0.0)


def cube_scaling(points: Floats, size: int = 1024) -> Scaling:
    """The scaling of a cloud to the cube [0, size - 1]^3 that keeps its aspect.

    The minimum of each axis is subtracted, then all axes are multiplied by (size - 1) over the
    largest remaining coordinate (thesis section 6.1.6).

    Parameters
    ----------
    points
        (n, 3), metres.
    size
        Number of grid positions along the longest axis.

    Raises
    ------
    InputError
        The cloud has no extent.
    """
    offset = points.min(axis=0)
    extent = float((points.max(axis=0) - offset).max())
    if extent <= 0:
        raise InputError("the cloud has no extent: all its points are the same")
    return Scaling((size - 1) / extent, np.asarray(offset))


def grid_scaling(points: Floats, about: Mapping[str, Any]) -> Scaling:
    """The scaling of voxel centres in metres back to their integer coordinates.

    Parameters
    ----------
    points
        (n, 3), metres.
    about
        The cloud's description with ``grid``: ``metres``, the side of a voxel, and ``origin`` (3,),
        the first voxel, in metres.

    Raises
    ------
    InputError
        The description has no grid, or a point is not on it.
    """
    grid = about.get("grid")
    if grid is None:
        raise InputError("size grid: the cloud's description has no grid")
    scaling = Scaling(1 / grid["metres"], np.asarray(grid["origin"], dtype=np.float64))
    voxels = scaling.apply(points)
    off = int(np.count_nonzero((np.abs(voxels - np.rint(voxels)) > _OFF_GRID).any(axis=1)))
    if off:
        raise InputError(f"size grid: {off} of {len(points)} points are not on the cloud's grid")
    return scaling

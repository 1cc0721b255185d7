from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import INTEGER_LIMIT, Floats, bounds

GRID = "grid"
"""Value of the option `size` for the voxel grid of the cloud's description."""
METRIC = "metric"
"""Value of the option `size` for metres in the original coordinate frame."""
FAR_M = 1000.0
"""Metric clouds are shifted along an axis on which all points lie farther than this from 0."""
_GRID_TOLERANCE = 1e-3
"""Largest distance from the grid, in voxels, far above rounding errors of conversions."""


class Scaling(NamedTuple):
    """A transform from metres: ``scaled = (metres - offset) * scale``.

    `offset` (3,) is in metres, `scale` in 1 / metre.
    """

    scale: float
    offset: Floats

    def apply(self, points: Floats) -> Floats:
        return (points - self.offset) * self.scale


def origin_shift(points: Floats) -> Floats:
    """Return the shift (3,), in whole metres, that brings points (n, 3) near the origin.

    The shift is 0 along axes on which a point lies within `FAR_M`.
    """
    low, high = bounds(points)
    nearest = np.where(low > 0, low, np.where(high < 0, high, 0.0))
    return np.where(np.abs(nearest) > FAR_M, np.trunc(nearest), 0.0)


def cube_scaling(points: Floats, size: int = 1024) -> Scaling:
    """Return the scaling of points (n, 3), m, to [0, size - 1]^3, as in PCC Arena (thesis, 6.1.6).

    It subtracts each axis's minimum, and multiplies by (size - 1) / largest extent.
    """
    if not 2 <= size < INTEGER_LIMIT:
        raise InputError(f"size is {size}, but must be from 2 to 2^53 (or 0: metres)")
    offset = points.min(axis=0)
    extent = float((points.max(axis=0) - offset).max())
    if extent <= 0:
        raise InputError("the cloud has no extent: all its points are the same")
    return Scaling((size - 1) / extent, np.asarray(offset))


def grid_scaling(points: Floats, about: Mapping[str, Any]) -> Scaling:
    """Return the scaling of voxel centres (n, 3) in metres to integers.

    The cloud's description `about` must have a ``grid``: the side of a voxel in ``metres``, and
    ``origin``, the centre of voxel (0, 0, 0). Raises InputError unless the points are on this grid.
    """
    grid = about.get("grid")
    if grid is None:
        raise InputError("size grid: the cloud's description has no grid")
    scaling = Scaling(1 / grid["metres"], np.asarray(grid["origin"], dtype=np.float64))
    voxels = scaling.apply(points)
    is_off_grid = (np.abs(voxels - np.rint(voxels)) > _GRID_TOLERANCE).any(axis=1)
    if count := int(np.count_nonzero(is_off_grid)):
        raise InputError(f"size grid: {count} of {len(points)} points are not on the cloud's grid")
    return scaling

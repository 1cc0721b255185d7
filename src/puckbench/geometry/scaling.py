from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import INTEGER_LIMIT, Floats, bounds

GRID = "grid"
"""Value of the option `size` that keeps the voxel grid given in the cloud's description."""
METRIC = "metric"
"""Value of the option `size` that keeps metres in the original coordinate frame."""
FAR_M = 1000.0
"""A metric cloud is shifted along an axis if all its points lie farther than this from 0, in m."""
_GRID_TOLERANCE = 1e-3
"""Largest distance from the grid, in voxels; it is far above the rounding errors of conversions."""

_STEPS_PER_UNIT = 2.0**16
"""A step is much larger than the differences of scaled coordinates between processors."""


class Scaling(NamedTuple):
    """A transform from metres to a cloud's coordinates: ``scaled = (metres - offset) * scale``.

    Parameters
    ----------
    scale
        Number of units per metre.
    offset
        Origin of the scaled coordinates, (3,), in m.
    """

    scale: float
    offset: Floats

    def apply(self, points: Floats) -> Floats:
        """Return the scaled coordinates, (n, 3), of `points` (n, 3) in m."""
        return (points - self.offset) * self.scale


def without_last_digits(scaled: Floats) -> Floats:
    """Round scaled coordinates, (n, 3), to multiples of 2^-16.

    The sines and cosines of a scan differ in their last digits between processors and between C
    libraries. Without these digits, the cloud of a scan is the same on almost every machine: a
    coordinate can only differ if it is very near the midpoint between two multiples.
    """
    return np.asarray(np.rint(scaled * _STEPS_PER_UNIT) / _STEPS_PER_UNIT)


def most_rounded_m(about: Mapping[str, Any]) -> float:
    """Return the largest distance, m, by which rounding can have moved a point of a prepared cloud.

    The rounding is that of `without_last_digits`. `about` is the description of the prepared cloud,
    with its scale in grid units per m. The distance is 0 for a cloud in metres, which is not
    rounded.
    """
    return 3**0.5 / 2 / _STEPS_PER_UNIT / about["scale"] if about.get("size") else 0.0


def origin_shift(points: Floats) -> Floats:
    """Return the shift, (3,), in whole metres, that brings `points` (n, 3) near the origin.

    The shift is to be subtracted from the points. It is 0 along an axis if a point lies within
    `FAR_M` of 0, or if there are points on both sides of 0.
    """
    low, high = bounds(points)
    nearest = np.where(low > 0, low, np.where(high < 0, high, 0.0))
    return np.where(np.abs(nearest) > FAR_M, np.trunc(nearest), 0.0)


def check_cube_size(size: int) -> None:
    """Raise InputError unless `size` is a valid number of positions along a side of a cube."""
    if not 2 <= size < INTEGER_LIMIT:
        raise InputError(f"size is {size}, but must be from 2 to 2^53 (or 0: metres)")


def cube_scaling(points: Floats, size: int = 1024) -> Scaling:
    """Return the scaling that fits points into the cube [0, size - 1]^3.

    It is that of PCC Arena (thesis, section 6.1.6). It subtracts the minimum of each axis, and
    multiplies all axes by (size - 1) / largest extent.

    Parameters
    ----------
    points
        Coordinates, (n, 3), in m.
    size
        Number of integer positions along a side of the cube.

    Raises
    ------
    InputError
        `size` is not valid, or all points are the same.
    """
    check_cube_size(size)
    offset = points.min(axis=0)
    extent = float((points.max(axis=0) - offset).max())
    if extent <= 0:
        raise InputError("the cloud has no extent: all its points are the same")
    return Scaling((size - 1) / extent, np.asarray(offset))


def grid_scaling(points: Floats, about: Mapping[str, Any]) -> Scaling:
    """Return the scaling that turns the voxel centres of a voxelised cloud into integers.

    Parameters
    ----------
    points
        Voxel centres, (n, 3), in m.
    about
        The cloud's description. Its entry ``grid`` must contain ``metres``, the side of a voxel,
        and ``origin``, the centre of voxel (0, 0, 0) in m.

    Raises
    ------
    InputError
        The description has no grid, or a point is not on the grid.
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

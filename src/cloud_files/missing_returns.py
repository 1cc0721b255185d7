from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

Mask = NDArray[np.bool_]

_MIN_SHARE = 1e-3
_MIN_RATIO = 2
_MIN_RINGS = 3
_POSITION_M = 1e-4
"""Nearer positions count as equal, because rotations in single precision round."""
_NEAR_POSITION_M = 0.05
"""Largest motion of a car between neighbouring columns of missing returns."""
_MAX_MOTION_M = 4.0
"""Largest motion in one frame: 80 m/s at 20 Hz."""
_MIN_RANGE_M = 0.2
"""Shortest range of spinning LiDARs."""


def missing_returns(xyz: Floats, is_organised: bool = False) -> Mask:
    """Return a mask (n,) of the points that stand for laser firings without a return.

    Such points have NaN coordinates or lie at the origin. In a cloud that is not organised, points
    at the origin count only if they are more than one in a thousand points, and more than twice the
    number of points at any other position.

    Parameters
    ----------
    xyz
        Points, (n, 3).
    is_organised
        Whether the cloud is a range image, in which all such points count.
    """
    empty: Mask = np.asarray(np.isnan(xyz).all(axis=1))
    zero: Mask = np.asarray((xyz == 0).all(axis=1))
    return empty | zero if is_organised or _zeros_are_missing(xyz, zero) else empty


def _zeros_are_missing(xyz: Floats, zero: Mask) -> bool:
    count = int(np.count_nonzero(zero))
    if count < _MIN_SHARE * len(xyz):
        return False
    others = xyz[~zero]
    if len(others) == 0:
        return False
    most_coincident = int(np.unique(others, axis=0, return_counts=True)[1].max())
    return count > _MIN_RATIO * most_coincident


def missing_firings(xyz: Floats, rings: NDArray[np.generic]) -> Mask:
    """Return a mask (n,) of the points of a frame that stand for laser firings without a return.

    Data sets such as nuScenes store such points at range 0; motion compensation then moves them by
    decimetres, equally for all lasers that fire together. The mask contains points within 5 cm of a
    position that three lasers share, and points within 0.2 m of the sensor.

    Parameters
    ----------
    xyz
        Points, (n, 3), m.
    rings
        Laser of each point, (n,).
    """
    from scipy.spatial import KDTree

    ranges = np.linalg.norm(xyz, axis=1)
    near = np.flatnonzero(ranges <= _MAX_MOTION_M)
    missing: Mask = np.asarray(ranges <= _MIN_RANGE_M)
    cells, place = np.unique(np.rint(xyz[near] / _POSITION_M), axis=0, return_inverse=True)
    pairs = np.unique(np.column_stack([place, rings[near]]), axis=0)
    shared = np.bincount(pairs[:, 0].astype(np.intp), minlength=len(cells)) >= _MIN_RINGS
    if shared.any():
        distances = KDTree(cells[shared] * _POSITION_M).query(xyz[near])[0]
        missing[near[distances <= _NEAR_POSITION_M]] = True
    return missing

"""Points of clouds that stand for firings of a sensor that had no return."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

Rows = NDArray[np.bool_]

_LEAST_SHARE = 1e-3
_TIMES_OTHERS = 2
_FEWEST_RINGS = 3
_PLACE_M = 1e-4
"""Places that are nearer to each other are one: single precision, moved by a rotation."""
_NEAR_PLACE_M = 0.05
"""A sensor on a car moves less between two of its columns that have several firings in vain."""
_MOST_MOVED_M = 4.0
"""In a turn: 80 m/s for a sensor that turns 20 times a second."""
_NEAR_M = 0.2
"""No spinning LiDAR measures nearer."""


def missing_returns(xyz: Floats, is_organised: bool = False) -> Rows:
    """Whether each point is none: without coordinates, or one of many exactly at the origin.

    In an image of a sensor (an organised cloud) a point at the origin is a pixel without a return.
    Elsewhere points there are missing returns if they are at least one in a thousand, and more than
    twice as many as lie together at any other place, unlike in a coarsely rounded cloud.

    Parameters
    ----------
    xyz
        Coordinates, (n, 3), not finite ones among them.
    is_organised
        Whether the rows are the pixels of an image.

    Returns
    -------
    ndarray
        (n,) bool.
    """
    empty: Rows = np.asarray(np.isnan(xyz).all(axis=1))
    zero: Rows = np.asarray((xyz == 0).all(axis=1))
    return empty | zero if is_organised or _are_missing(xyz, zero) else empty


def _are_missing(xyz: Floats, zero: Rows) -> bool:
    count = int(np.count_nonzero(zero))
    if count < _LEAST_SHARE * len(xyz):
        return False
    others = xyz[~zero]
    if len(others) == 0:  # a cloud of one place
        return False
    most = int(np.unique(others, axis=0, return_counts=True)[1].max())
    return count > _TIMES_OTHERS * most


def missing_firings(xyz: Floats, rings: NDArray[np.generic]) -> Rows:
    """Whether each point of a frame is a firing without a return, moved with the car or not.

    Frames such as those of nuScenes keep firings without a return at range 0. Where the motion of
    the car was corrected, these stand where the sensor was at that moment: some decimetres from the
    origin, and at one place for all lasers that fired in vain then, while beams of several lasers
    never end in one point. A point is such a firing if points of at least three rings share its
    place, if it lies within 5 cm of such a place, or within 0.2 m of the sensor.

    Parameters
    ----------
    xyz
        Coordinates in the sensor's frame, m, (n, 3), not finite ones among them.
    rings
        Each point's laser, (n,).

    Returns
    -------
    ndarray
        (n,) bool; False for points that are not finite.
    """
    from scipy.spatial import KDTree

    away = np.linalg.norm(xyz, axis=1)
    near = np.flatnonzero(away <= _MOST_MOVED_M)
    missing: Rows = np.asarray(away <= _NEAR_M)
    cells, place = np.unique(np.rint(xyz[near] / _PLACE_M), axis=0, return_inverse=True)
    pairs = np.unique(np.column_stack([place, rings[near]]), axis=0)
    shared = np.bincount(pairs[:, 0].astype(np.intp), minlength=len(cells)) >= _FEWEST_RINGS
    if shared.any():
        nearest = KDTree(cells[shared] * _PLACE_M).query(xyz[near])[0]
        missing[near[nearest <= _NEAR_PLACE_M]] = True
    return missing

"""Elongation of a cloud: shortest over longest side of its bounding box."""

from __future__ import annotations

import numpy as np

from puckbench.geometry.cloud import Floats, check_points


def elongation(points: Floats) -> float:
    """Return the elongation of the axis-aligned bounding box (thesis section 6.1), 0 for one point.

    Parameters
    ----------
    points
        (n, 3), in any unit.

    Raises
    ------
    InputError
        There are no points, or some are not finite.
    """
    check_points(points, "elongation")
    return _ratio(np.ptp(points, axis=0))


def oriented_elongation(points: Floats) -> float:
    """Return the elongation of the box along the principal axes of the convex hull's vertices.

    This is Open3D's oriented bounding box, with which the thesis's values were measured. It is not
    the box of least volume: it tilts if two principal axes have similar lengths or if hull vertices
    cluster, so that a box of 8 x 4 x 2 filled at random has 0.29 instead of 0.25. A flat cloud has
    0.

    Parameters
    ----------
    points
        (n, 3), in any unit.

    Raises
    ------
    InputError
        There are no points, or some are not finite.
    """
    from scipy.spatial import ConvexHull, QhullError

    check_points(points, "elongation")
    try:
        corners = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # flat, or too few points to enclose a volume
        return 0.0
    centred = corners - corners.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return _ratio(np.ptp(centred @ axes, axis=0))


def _ratio(sides: Floats) -> float:
    return float(sides.min() / sides.max()) if sides.max() > 0 else 0.0

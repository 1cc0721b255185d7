from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats, check_points


def elongation(points: Floats) -> float:
    """Return how elongated a cloud is: the shortest side of its bounding box over the longest side.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1.

    Returns
    -------
    float
        Ratio from 0 (flat, or a single point) to 1 (a cube).
    """
    check_points(points, "elongation")
    return _ratio(np.ptp(points, axis=0))


def oriented_elongation(points: Floats) -> float:
    """Return the same ratio as `elongation` for an oriented bounding box, as in the thesis.

    As in Open3D, the box's axes are the principal axes of the convex hull's vertices. The result is
    0 if the points (n, 3) enclose no volume.
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

from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats, check_points


def elongation(points: Floats) -> float:
    """Return the ratio of shortest to longest side of the bounding box; 0 for a single point."""
    check_points(points, "elongation")
    return _ratio(np.ptp(points, axis=0))


def oriented_elongation(points: Floats) -> float:
    """Return the `elongation` of Open3D's oriented bounding box, as in the thesis.

    The box's axes are the principal axes of the convex hull's vertices.
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

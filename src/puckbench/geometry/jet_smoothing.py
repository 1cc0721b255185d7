from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats

LEAST_NEIGHBOURS = 6
"""Number of coefficients of a quadric."""


def smooth_by_jets(points: Floats, neighbours: int) -> Floats:
    """Smooth points by moving each onto a quadric that CGAL fits to its nearest neighbours.

    Some points are not moved: those that would move farther than their most distant neighbour, such
    as points on a line, and all points of clouds with fewer than `LEAST_NEIGHBOURS` points.

    Parameters
    ----------
    points
        Coordinates, (n, 3).
    neighbours
        Number of nearest neighbours, including the point itself, to which a quadric is fitted.

    Returns
    -------
    numpy.ndarray
        Smoothed coordinates, (n, 3), in the order of `points`.

    References
    ----------
    Cazals and Pouget, Estimating differential quantities using polynomial fitting of osculating
    jets, Computer Aided Geometric Design 22 (2005).
    """
    if len(points) < LEAST_NEIGHBOURS:
        return points
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Point_set_3 import Point_set_3
    from CGAL.CGAL_Point_set_processing_3 import jet_smooth_point_set
    from pykdtree.kdtree import KDTree

    order = np.lexsort(points.T)  # so that the result does not depend on the order
    points = points[order]
    cloud = Point_set_3()
    for x, y, z in points.tolist():
        cloud.insert(Point_3(x, y, z))
    neighbours = min(neighbours, len(points))
    jet_smooth_point_set(cloud, neighbours)
    smooth = np.array([(point.x(), point.y(), point.z()) for point in cloud.points()])
    reach = KDTree(points).query(points, k=neighbours)[0][:, -1]
    is_near = np.linalg.norm(smooth - points, axis=1) <= reach
    result = np.empty_like(points)
    result[order] = np.where(is_near[:, None], smooth, points)
    return result

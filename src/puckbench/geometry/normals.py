from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.geometry.spatial_order import morton_order


def estimate_normals(points: Floats, neighbours: int = 30) -> Floats:
    """Estimate the normal of each point from its nearest neighbours (thesis, section 6.1.2).

    Parameters
    ----------
    points
        Coordinates, (n, 3).
    neighbours
        Number of nearest neighbours to which Open3D fits a plane.

    Returns
    -------
    numpy.ndarray
        Unit normals, (n, 3), whose signs are arbitrary. For fewer than three points, they are
        (0, 0, 1).
    """
    import open3d as o3d

    order = morton_order(points)  # four times faster than points in random order
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[order]))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(neighbours))
    normals = np.empty_like(points)
    normals[order] = np.asarray(cloud.normals)
    return normals

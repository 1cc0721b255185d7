"""Normals estimated from neighbouring points (thesis section 6.1.2: Open3D, 30 neighbours)."""

from __future__ import annotations

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.geometry.spatial_order import morton_order


def estimate_normals(points: Floats, neighbours: int = 30) -> Floats:
    """Unit normals (n, 3) of the least-squares planes through each point's neighbours.

    The sign is Open3D's: metrics square the projections, so that it has no effect there.
    A cloud of fewer than three points gets (0, 0, 1).
    """
    import open3d as o3d

    order = morton_order(points)  # points in random order cost four times as much
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[order]))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(neighbours))
    normals = np.empty_like(points)
    normals[order] = np.asarray(cloud.normals)
    return normals

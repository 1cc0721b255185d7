from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Mesh


def sample_surface(mesh: Mesh, points: int, rng: np.random.Generator) -> PointCloud:
    """Draw random points on a mesh, uniformly by area.

    The method is that of Osada et al. 2002, equation 1 (thesis, section 6.1.1).

    Parameters
    ----------
    mesh
        The mesh to sample.
    points
        Number of points to draw.
    rng
        Generator of the random numbers.

    Returns
    -------
    PointCloud
        The points, with the normals and, if the mesh has labels, the primitive labels of their
        triangles.
    """
    cumulative = np.cumsum(mesh.areas())
    where = rng.random(points) * cumulative[-1]
    triangle = np.searchsorted(cumulative, where, side="right")
    root, r2 = np.sqrt(rng.random(points))[:, None], rng.random(points)[:, None]
    a, b, c = mesh.vertices[mesh.triangles[triangle]].swapaxes(0, 1)
    xyz = (1 - root) * a + root * (1 - r2) * b + root * r2 * c
    labels = None if mesh.labels is None else mesh.labels.primitive_id[triangle]
    return PointCloud(xyz=xyz, normals=mesh.normals()[triangle], labels=labels)

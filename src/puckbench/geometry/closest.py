"""Closest points of a triangle mesh, found in single and refined in double precision."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.core.open3d_library import open3d
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh


@dataclass(frozen=True)
class SurfacePoints:
    """Points (m, 3) on a mesh, unit normals (m, 3) and indices (m,) of their triangles."""

    xyz: Floats
    normals: Floats
    triangles: NDArray[np.int64]


def mesh_in_frame(mesh: Mesh, scale: float, offset: Floats | tuple[float, float, float]) -> Mesh:
    """Transform a mesh in metres to a cloud's frame: ``(vertices - offset) * scale``.

    Parameters
    ----------
    mesh
        In metres.
    scale
        Units of the cloud per metre, from the cloud's `about`.
    offset
        (3,), metres, from the cloud's `about`.
    """
    return replace(mesh, vertices=(mesh.vertices - np.asarray(offset)) * scale)


def closest_surface_points(mesh: Mesh, points: Floats) -> SurfacePoints:
    """Find the point of a mesh that is closest to each query point.

    Embree (through Open3D) finds the triangle in single precision, after a shift of the mesh's
    middle to the origin, where that is most exact; the closest point of this triangle is then
    computed in double precision. Triangles without area are left out. On an edge that triangles
    share, Embree's choice of the triangle decides the normal.

    Parameters
    ----------
    mesh
        In the frame of the points.
    points
        Queries, (m, 3).
    """
    solid = np.flatnonzero(mesh.areas() > 0)
    corners = mesh.corners()[solid]
    chosen = _closest_triangles(corners, points)
    closest = _closest_on_triangles(np.ascontiguousarray(points, np.float64), corners[chosen])
    return SurfacePoints(closest, mesh.normals()[solid[chosen]], solid[chosen])


def _closest_triangles(corners: Floats, points: Floats) -> NDArray[np.int64]:
    o3d = open3d()

    middle = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    soup = (corners - middle).reshape(-1, 3).astype(np.float32)
    scene = o3d.t.geometry.RaycastingScene()
    numbers = np.arange(len(soup), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(o3d.core.Tensor.from_numpy(soup), o3d.core.Tensor.from_numpy(numbers))
    queries = (points - middle).astype(np.float32)
    found = scene.compute_closest_points(o3d.core.Tensor.from_numpy(queries))
    return np.asarray(found["primitive_ids"].numpy(), dtype=np.int64)


@compiled
def _closest_on_triangles(points: Floats, corners: Floats) -> Floats:
    """Closest point of triangle i, corners (m, 3, 3), to point i.

    The foot of the perpendicular where it lies inside the triangle, else the best of the edges.
    """
    closest = np.empty((len(points), 3))
    for i in range(len(points)):
        p, a, b, c = points[i], corners[i, 0], corners[i, 1], corners[i, 2]
        u, v = _barycentric(p - a, b - a, c - a)
        if u >= 0 and v >= 0 and u + v <= 1:
            closest[i] = a + u * (b - a) + v * (c - a)
            continue
        least = np.inf
        for start, end in ((a, b), (b, c), (c, a)):
            on_edge = _closest_on_segment(p, start, end)
            squared = np.sum((p - on_edge) ** 2)
            if squared < least:
                least = squared
                closest[i] = on_edge
    return closest


@compiled
def _barycentric(p: Floats, b: Floats, c: Floats) -> tuple[float, float]:
    """Coordinates of p's foot in the plane that b and c span from the origin."""
    bb, bc, cc = np.sum(b * b), np.sum(b * c), np.sum(c * c)
    pb, pc = np.sum(p * b), np.sum(p * c)
    determinant = bb * cc - bc * bc
    if determinant <= 0:
        return -1.0, -1.0
    return (cc * pb - bc * pc) / determinant, (bb * pc - bc * pb) / determinant


@compiled
def _closest_on_segment(p: Floats, start: Floats, end: Floats) -> Floats:
    along = end - start
    t = np.sum((p - start) * along) / np.sum(along * along)
    return start + min(1.0, max(0.0, t)) * along

"""Search for the closest points on a triangle mesh.

The closest triangle is searched in single precision; the point on this triangle is computed in
double precision.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh


@dataclass(frozen=True)
class SurfacePoints:
    """Points on a mesh, for example those closest to given points.

    Parameters
    ----------
    xyz
        Coordinates, (m, 3), in the unit of the mesh.
    normals
        Unit normals of the triangles on which the points lie, (m, 3).
    triangles
        Indices of these triangles in the mesh, (m,).
    """

    xyz: Floats
    normals: Floats
    triangles: NDArray[np.int64]


def mesh_in_frame(mesh: Mesh, scale: float, offset: Floats | tuple[float, float, float]) -> Mesh:
    """Transform a mesh from metres to a cloud's coordinates: ``(vertices - offset) * scale``.

    Parameters
    ----------
    mesh
        The mesh, whose vertices are in m.
    scale
        Scale of the cloud, in units per metre.
    offset
        Origin of the cloud's coordinates, (3,), in m.
    """
    return replace(mesh, vertices=(mesh.vertices - np.asarray(offset)) * scale)


class SearchableMesh:
    """A triangle mesh prepared for finding the points of its surface closest to given points.

    Embree searches the closest triangle in single precision. A point closest to an edge that two
    triangles share may therefore be assigned to either of them.
    """

    def __init__(self, mesh: Mesh) -> None:
        import open3d as o3d

        self._solid = np.flatnonzero(mesh.areas() > 0)
        self._corners = mesh.corners()[self._solid]
        self._normals = mesh.normals()[self._solid]
        self._middle = (self._corners.min(axis=(0, 1)) + self._corners.max(axis=(0, 1))) / 2
        vertices = (self._corners - self._middle).reshape(-1, 3).astype(np.float32)
        indices = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
        self._scene: Any = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(*map(o3d.core.Tensor.from_numpy, (vertices, indices)))

    def closest(self, points: Floats) -> SurfacePoints:
        """Return the points on the mesh closest to `points` (m, 3), in the same order."""
        triangles = self._closest_triangles(points)
        queries = np.ascontiguousarray(points, np.float64)
        closest = _closest_on_triangles(queries, self._corners[triangles])
        return SurfacePoints(closest, self._normals[triangles], self._solid[triangles])

    def _closest_triangles(self, points: Floats) -> NDArray[np.int64]:
        import open3d as o3d

        queries = (points - self._middle).astype(np.float32)
        closest = self._scene.compute_closest_points(o3d.core.Tensor.from_numpy(queries))
        return np.asarray(closest["primitive_ids"].numpy(), dtype=np.int64)


def closest_surface_points(mesh: Mesh | SearchableMesh, points: Floats) -> SurfacePoints:
    """Return the points on a mesh closest to `points` (m, 3), in the same order."""
    searchable = SearchableMesh(mesh) if isinstance(mesh, Mesh) else mesh
    return searchable.closest(points)


@compiled
def _closest_on_triangles(points: Floats, corners: Floats) -> Floats:
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

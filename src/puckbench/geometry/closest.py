"""Closest points of a triangle mesh, found in single and refined in double precision."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
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


class Surface:
    """A triangle mesh, made ready once for all points whose closest points on it are searched.

    Embree (through Open3D) finds the triangle in single precision, after a shift of the mesh's
    middle to the origin, where that is most exact; the closest point of this triangle is then
    computed in double precision. Triangles without area are left out. On an edge that triangles
    share, Embree's choice of the triangle decides the normal.

    Parameters
    ----------
    mesh
        In the frame of the points.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._solid = np.flatnonzero(mesh.areas() > 0)
        self._corners = mesh.corners()[self._solid]
        self._normals = mesh.normals()[self._solid]
        self._middle = (self._corners.min(axis=(0, 1)) + self._corners.max(axis=(0, 1))) / 2
        self._scene = self._ray_casting_scene()

    @classmethod
    def of(cls, mesh: Mesh | Surface) -> Surface:
        """The surface itself, or a mesh made ready."""
        return mesh if isinstance(mesh, cls) else cls(cast(Mesh, mesh))

    def closest(self, points: Floats) -> SurfacePoints:
        """The closest points of the surface to `points` (m, 3)."""
        chosen = self._closest_triangles(points)
        queries = np.ascontiguousarray(points, np.float64)
        closest = _closest_on_triangles(queries, self._corners[chosen])
        return SurfacePoints(closest, self._normals[chosen], self._solid[chosen])

    def _ray_casting_scene(self) -> Any:
        import open3d as o3d

        soup = (self._corners - self._middle).reshape(-1, 3).astype(np.float32)
        scene = o3d.t.geometry.RaycastingScene()
        numbers = np.arange(len(soup), dtype=np.uint32).reshape(-1, 3)
        scene.add_triangles(o3d.core.Tensor.from_numpy(soup), o3d.core.Tensor.from_numpy(numbers))
        return scene

    def _closest_triangles(self, points: Floats) -> NDArray[np.int64]:
        import open3d as o3d

        queries = (points - self._middle).astype(np.float32)
        found = self._scene.compute_closest_points(o3d.core.Tensor.from_numpy(queries))
        return np.asarray(found["primitive_ids"].numpy(), dtype=np.int64)


def closest_surface_points(mesh: Mesh | Surface, points: Floats) -> SurfacePoints:
    """Find the point of a mesh that is closest to each query point, as `Surface` does.

    Parameters
    ----------
    mesh
        In the frame of the points; as a `Surface` where it is searched several times.
    points
        Queries, (m, 3).
    """
    return Surface.of(mesh).closest(points)


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

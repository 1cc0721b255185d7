"""Ray casting: Embree (in Open3D) finds the triangle hit, whose plane gives the distance.

Embree computes in float32, with errors of about 1e-6 of the coordinates. Therefore the mesh is
translated to put the sensor at the origin, and distances are computed again in float64.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from virtual_lidar.errors.model import Hits, Surfaces
from virtual_lidar.sweep import Rays
from virtual_lidar.trajectory import Poses

_LEAST_COSINE = 1e-9
"""Below this cosine between ray and normal, Embree's distance is more accurate than the plane's."""


@dataclass(frozen=True)
class Cast:
    """Rays in world coordinates: directions (n, 3), origins of steps (steps, 3), and hits."""

    directions: Floats
    origins: Floats
    hits: Hits


class RayCaster:
    """Casts rays at a mesh from positions at or near `origin` (3,).

    `planes` (t, 4) are unit normals of triangles, and distances of their planes from `origin`.
    """

    def __init__(self, mesh: Mesh, origin: Floats, threads: int = 0) -> None:
        import open3d as o3d

        self.threads = threads
        self.origin = np.asarray(origin, dtype=np.float64)
        self.planes = planes_of(mesh, self.origin)
        unlabelled = np.full(len(mesh.triangles), -1, dtype=np.int32)
        self.object_id = mesh.labels.object_id if mesh.labels else unlabelled
        self.primitive_id = mesh.labels.primitive_id if mesh.labels else unlabelled
        self.surfaces = (
            Surfaces(mesh.labels.object_id, mesh.labels.objects) if mesh.labels else None
        )
        self.scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
        self.scene.add_triangles(
            o3d.core.Tensor.from_numpy((mesh.vertices - self.origin).astype(np.float32)),
            o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
        )

    def cast(self, rays: Rays, poses: Poses, limits: tuple[float, float]) -> Cast:
        (yaw_sine, yaw_cosine), (z, level) = _sine_cosine(rays.yaw), _sine_cosine(rays.pitch)
        x, y = -yaw_sine * level, yaw_cosine * level
        turned = np.moveaxis(poses.rotations, (-2, -1), (0, 1))[..., None]
        rows = [turn[0] * x + turn[1] * y + turn[2] * z for turn in turned]
        directions = np.stack([row.ravel() for row in rows], axis=1)
        starts = np.ascontiguousarray(poses.positions).reshape(-1, 3)
        hits = self.hits(directions, starts, rays.yaw.shape, limits)
        return Cast(directions, self.origin + starts, hits)

    def clearances(self, places: Floats) -> Floats:
        import open3d as o3d

        queries = o3d.core.Tensor.from_numpy(places.astype(np.float32))
        return np.asarray(self.scene.compute_distance(queries).numpy(), dtype=np.float64)

    def met(self, starts: Floats, directions: Floats) -> tuple[Floats, NDArray[np.uint32]]:
        """Cast rays; return distances (n,) of float32 accuracy (inf: miss) and triangles (n,)."""
        import open3d as o3d

        single = np.column_stack([starts, directions]).astype(np.float32)
        answer = self.scene.cast_rays(o3d.core.Tensor.from_numpy(single), nthreads=self.threads)
        return answer["t_hit"].numpy().astype(np.float64), answer["primitive_ids"].numpy()

    def hits(
        self,
        directions: Floats,
        starts: Floats,
        shape: tuple[int, ...],
        limits: tuple[float, float],
    ) -> Hits:
        """Return the hits of rays (n, 3), reshaped to `shape`, at distances within `limits`.

        `starts`, (steps, 3) or (n, 3), are relative to `origin`.
        """
        starts = np.repeat(starts, len(directions) // len(starts), axis=0)
        nearest, triangle = self.met(starts, directions)
        planes = self.planes.take(np.where(np.isfinite(nearest), triangle, 0), axis=0)
        distance, cosine = plane_distances(directions, starts, nearest, planes, limits)
        return Hits(distance, triangle, np.arccos(cosine), self.surfaces).reshaped(shape)


def plane_distances(
    directions: Floats, starts: Floats, nearest: Floats, planes: Floats, limits: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Compute distances (n,), m, along rays (n, 3) to planes (n, 4), and cosines of incidence.

    They are inf and nan for a miss, or a distance outside `limits`. `nearest` (n,) are distances
    from Embree (inf for a miss), which are kept for rays parallel to their planes.
    """
    cosine = dot(planes, directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (planes[:, 3] - dot(planes, starts)) / cosine
    distance = np.where(np.abs(cosine) > _LEAST_COSINE, distance, nearest)
    is_hit = np.isfinite(nearest) & (distance >= limits[0]) & (distance <= limits[1])
    cosine = np.where(is_hit, np.minimum(np.abs(cosine), 1.0), np.nan)
    return np.where(is_hit, distance, np.inf), cosine


def dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar products (n,) of the first three columns."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def planes_of(mesh: Mesh, origin: Floats) -> Floats:
    """Return planes (t, 4): unit normals (0 if degenerate) and distances from `origin`."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    length = np.sqrt(dot(normals, normals))[:, None]
    normals = np.divide(normals, length, out=normals, where=length > 0)
    return np.column_stack([normals, dot(normals, a - origin)])


def _sine_cosine(angles: Floats) -> tuple[Floats, Floats]:
    # Each value of a broadcast array is computed once.
    values = angles[tuple(slice(None) if stride else slice(1) for stride in angles.strides)]
    return np.sin(values), np.cos(values)

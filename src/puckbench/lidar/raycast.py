"""Ray casting: Embree (in Open3D) finds the triangle hit, whose plane gives the distance.

Embree computes in float32, with errors of about 1e-6 of the coordinates. Therefore the mesh is
translated to put the sensor at the origin, and distances are computed again in float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.lidar.errors.model import Hits, Surfaces
from puckbench.lidar.sweep import Rays
from puckbench.lidar.trajectory import Poses


@dataclass(frozen=True)
class Cast:
    """Rays that were cast, in the world: directions (n, 3), origins of steps (steps, 3), hits."""

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
        self.planes = _planes(mesh, self.origin)
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
        from puckbench.lidar.kernels import fill_directions

        directions = np.empty((rays.yaw.size, 3))
        single = np.zeros((rays.yaw.size, 6), dtype=np.float32)
        fill_directions(
            _sine_cosine(rays.yaw), _sine_cosine(rays.pitch), poses.rotations, directions, single
        )
        starts = np.ascontiguousarray(poses.positions).reshape(-1, 3)
        if starts.any():
            single[:, :3] = np.repeat(starts, len(single) // len(starts), axis=0)
        hits = self.hits(directions, single, starts, rays.yaw.shape, limits)
        return Cast(directions, self.origin + starts, hits)

    def clearances(self, places: Floats) -> Floats:
        import open3d as o3d

        queries = o3d.core.Tensor.from_numpy(places.astype(np.float32))
        return np.asarray(self.scene.compute_distance(queries).numpy(), dtype=np.float64)

    def met(self, starts: Floats, directions: Floats) -> tuple[Floats, NDArray[np.uint32]]:
        """Cast rays; return distances (n,) of float32 accuracy (inf: miss) and triangles (n,)."""
        answer = self._nearest(np.column_stack([starts, directions]).astype(np.float32))
        return answer["t_hit"].numpy().astype(np.float64), answer["primitive_ids"].numpy()

    def hits(
        self,
        directions: Floats,
        single: NDArray[np.float32],
        starts: Floats,
        shape: tuple[int, ...],
        limits: tuple[float, float],
    ) -> Hits:
        """Return the hits of rays, reshaped to `shape`.

        `single` (n, 6) are float32 origins and directions, for Embree; `starts`, (steps, 3) or (n,
        3), are float64 origins. Both are relative to `origin`.
        """
        from puckbench.lidar.kernels import fill_distances

        answer = self._nearest(single)
        triangle = answer["primitive_ids"].numpy()
        distance, cosine = np.empty(len(directions)), np.empty(len(directions))
        nearest = answer["t_hit"].numpy()
        fill_distances(directions, nearest, triangle, self.planes, starts, limits, distance, cosine)
        incidence = np.arccos(cosine, out=cosine)
        return Hits(distance, triangle, incidence, self.surfaces).reshaped(shape)

    def _nearest(self, single: NDArray[np.float32]) -> Any:
        import open3d as o3d

        return self.scene.cast_rays(o3d.core.Tensor.from_numpy(single), nthreads=self.threads)


def _planes(mesh: Mesh, origin: Floats) -> Floats:
    from puckbench.lidar.kernels import fill_planes

    planes = np.empty((len(mesh.triangles), 4))
    vertices, triangles = np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.triangles)
    fill_planes(vertices, triangles, origin, planes)
    return planes


def _sine_cosine(angles: Floats) -> tuple[Floats, Floats]:
    # Each value of a broadcast array is computed once.
    index = tuple(slice(None) if stride else slice(1) for stride in angles.strides)
    values = angles[index]
    sine, cosine = np.sin(values), np.cos(values)
    return np.broadcast_to(sine, angles.shape), np.broadcast_to(cosine, angles.shape)

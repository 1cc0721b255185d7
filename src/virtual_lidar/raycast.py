"""Casting of rays at a mesh.

The library Embree (through Open3D) finds the triangle that a ray hits, and the plane of the
triangle gives the distance. Embree computes in float32, with errors of about 1e-6 of the
coordinates. Therefore the mesh is first translated to put the sensor at the origin, and distances
are computed again in float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from virtual_lidar.errors.model import Hits, Surfaces
from virtual_lidar.sweep import Rays
from virtual_lidar.trajectory import Poses

_MOST_MIRRORS = 8
"""Limit of reflections; a path with more has no return."""
_OFF_THE_MIRROR = 1e-4
"""Offset, m, of a reflected ray's start, so that rounding to float32 causes no second hit."""


@dataclass(frozen=True)
class Cast:
    """Rays in world coordinates, and what each of them hits.

    Parameters
    ----------
    directions
        Unit vectors, (n, 3): one for each laser, in each azimuth step of each frame.
    origins
        Position of the sensor in each azimuth step of each frame, (azimuth steps, 3), m.
    hits
        What each ray hits first.
    """

    directions: Floats
    origins: Floats
    hits: Hits


class RayCaster:
    """Casts rays at one mesh, from positions at or near `origin`.

    Parameters
    ----------
    mesh
        The scene, m; `check_mesh` must accept it.
    origin
        Position in world coordinates, (3,), m. Other positions are relative to it, and lose
        precision far away from it.
    threads
        Number of threads; 0 means one per processor.

    Attributes
    ----------
    planes
        Planes of the triangles, (t, 4): unit normal (0 for a triangle without area), and distance
        from `origin`, m.
    object_id, primitive_id
        Object and geometric primitive of each triangle, (t,); -1 if the mesh has no labels.
    surfaces
        Objects of the triangles; None if the mesh has no labels.
    """

    def __init__(self, mesh: Mesh, origin: Floats, threads: int = 0) -> None:
        import open3d as o3d

        self.threads = threads
        self.origin = np.asarray(origin, dtype=np.float64)
        self.planes = _planes_of(mesh, self.origin)
        labels, unlabelled = mesh.labels, np.full(len(mesh.triangles), -1, dtype=np.int32)
        self.object_id = labels.object_id if labels else unlabelled
        self.primitive_id = labels.primitive_id if labels else unlabelled
        self.surfaces = Surfaces(labels.object_id, labels.objects) if labels else None
        self.scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
        self.scene.add_triangles(
            o3d.core.Tensor.from_numpy((mesh.vertices - self.origin).astype(np.float32)),
            o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
        )

    def cast(self, rays: Rays, poses: Poses, limits: tuple[float, float]) -> Cast:
        """Cast the rays of a sensor from its poses and return what they hit.

        Parameters
        ----------
        rays
            Directions in sensor coordinates.
        poses
            Pose of the sensor in each azimuth step, relative to `origin`.
        limits
            Least and greatest distance of a hit, m. A ray whose distance is outside has no hit.
        """
        from virtual_lidar.kernels import fill_directions

        directions = np.empty((rays.yaw.size, 3))
        rotations = np.ascontiguousarray(poses.rotations)
        fill_directions(_sine_cosine(rays.yaw), _sine_cosine(rays.pitch), rotations, directions)
        starts = np.ascontiguousarray(poses.positions).reshape(-1, 3)
        hits = self.hits(directions, starts, rays.yaw.shape, limits)
        return Cast(directions, self.origin + starts, hits)

    def clearances(self, places: Floats) -> Floats:
        """Return the distance of each position (n, 3) from the nearest surface, (n,), m."""
        import open3d as o3d

        queries = o3d.core.Tensor.from_numpy(places.astype(np.float32))
        return np.asarray(self.scene.compute_distance(queries).numpy(), dtype=np.float64)

    def met(self, starts: Floats, directions: Floats) -> tuple[Floats, NDArray[np.uint32]]:
        """Return at which distances rays first meet the mesh, and which triangles they meet.

        Parameters
        ----------
        starts
            Starting points, (n, 3), m, relative to `origin`.
        directions
            Unit vectors, (n, 3).

        Returns
        -------
        tuple of arrays
            Distances, (n,), m, with the accuracy of float32, inf for a ray that meets nothing; and
            numbers of the triangles, (n,).
        """
        answer = self._nearest(starts, directions)
        return answer["t_hit"].numpy().astype(np.float64), answer["primitive_ids"].numpy()

    def _nearest(self, starts: Floats, directions: Floats) -> Any:
        import open3d as o3d

        single = np.empty((len(directions), 6), dtype=np.float32)
        single.reshape(len(starts), -1, 6)[:, :, :3] = starts[:, None]
        single[:, 3:] = directions
        return self.scene.cast_rays(o3d.core.Tensor.from_numpy(single), nthreads=self.threads)

    def hits(
        self,
        directions: Floats,
        starts: Floats,
        shape: tuple[int, ...],
        limits: tuple[float, float],
    ) -> Hits:
        """Return the first hit of each ray whose distance is within limits.

        Parameters
        ----------
        directions
            Unit vectors, (n, 3).
        starts
            Starting points relative to `origin`, (n, 3), m. Fewer starting points than rays are
            allowed: each then belongs to the same number of successive rays.
        shape
            Shape of the arrays in the result.
        limits
            Least and greatest distance of a hit, m.
        """
        from virtual_lidar.kernels import fill_distances

        answer = self._nearest(starts, directions)
        nearest, triangle = answer["t_hit"].numpy(), answer["primitive_ids"].numpy()
        distance, cosine = np.empty(len(directions)), np.empty(len(directions))
        fill_distances(directions, starts, nearest, triangle, self.planes, limits, distance, cosine)
        incidence = np.arccos(cosine, out=cosine)
        return Hits(distance, triangle, incidence, self.surfaces).reshaped(shape)


def _planes_of(mesh: Mesh, origin: Floats) -> Floats:
    from virtual_lidar.kernels import fill_planes

    planes = np.empty((len(mesh.triangles), 4))
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    fill_planes(vertices, np.ascontiguousarray(mesh.triangles), origin, planes)
    return planes


def _sine_cosine(angles: Floats) -> tuple[Floats, Floats]:
    values = distinct(angles)
    return np.sin(values), np.cos(values)


def distinct(values: Floats) -> Floats:
    """Return an array without the repetitions of a broadcast array: its axes have length 1."""
    once = values[tuple(slice(None) if stride else slice(1) for stride in values.strides)]
    return np.ascontiguousarray(once)


@dataclass(frozen=True)
class _Paths:
    """Paths of rays that have met only mirrors so far, each with the last segment of the path."""

    rays: NDArray[np.int64]
    directions: Floats
    ends: Floats
    lengths: Floats
    triangles: NDArray[np.uint32]

    def select(self, chosen: NDArray[np.bool_]) -> _Paths:
        return _Paths(**{name: part[chosen] for name, part in vars(self).items()})


def follow_mirrors(
    caster: RayCaster, cast: Cast, mirrors: NDArray[np.bool_], farthest: float
) -> Cast:
    """Replace each hit on a mirror by what the reflected ray hits.

    Parameters
    ----------
    caster
        Ray caster of the scene.
    cast
        Rays and their first hits.
    mirrors
        Mask (t,) of the triangles that are mirrors.
    farthest
        Greatest length of a whole path, m.

    Returns
    -------
    Cast
        The same rays. The distance of a hit is the length of the whole path, reflections included.
        A path that meets nothing but mirrors has no hit.
    """
    shape = cast.hits.distance.shape
    distance, triangle = cast.hits.distance.ravel().copy(), cast.hits.triangle.ravel().copy()
    incidence = cast.hits.incidence.ravel().copy()
    paths = _paths_to_mirrors(caster, cast, mirrors)
    distance[paths.rays], incidence[paths.rays] = np.inf, np.nan
    for _ in range(_MOST_MIRRORS):
        if not len(paths.rays):
            break
        paths, angles = _reflected(caster, paths)
        hit = paths.lengths <= farthest
        again = hit & mirrors[np.where(hit, paths.triangles, 0)]
        seen, rays = hit & ~again, paths.rays[hit & ~again]
        distance[rays], triangle[rays] = paths.lengths[seen], paths.triangles[seen]
        incidence[rays] = angles[seen]
        paths = paths.select(again)
    hits = Hits(distance, triangle, incidence, caster.surfaces)
    return Cast(cast.directions, cast.origins, hits.reshaped(shape))


def _paths_to_mirrors(caster: RayCaster, cast: Cast, mirrors: NDArray[np.bool_]) -> _Paths:
    lengths, triangles = cast.hits.distance.ravel(), cast.hits.triangle.ravel()
    hit = np.isfinite(lengths)
    rays = np.flatnonzero(hit & mirrors[np.where(hit, triangles, 0)])
    starts = cast.origins[rays // (len(lengths) // len(cast.origins))] - caster.origin
    directions = cast.directions[rays]
    ends = starts + lengths[rays, None] * directions
    return _Paths(rays, directions, ends, lengths[rays], triangles[rays])


def _reflected(caster: RayCaster, paths: _Paths) -> tuple[_Paths, Floats]:
    normals = caster.planes[paths.triangles, :3]
    across = (paths.directions * normals).sum(axis=1, keepdims=True)
    turned = paths.directions - 2 * across * normals
    starts = paths.ends + _OFF_THE_MIRROR * turned
    seen = caster.hits(turned, starts, paths.rays.shape, (0.0, np.inf))
    ends = starts + np.where(np.isfinite(seen.distance), seen.distance, 0)[:, None] * turned
    lengths = paths.lengths + _OFF_THE_MIRROR + seen.distance
    return _Paths(paths.rays, turned, ends, lengths, seen.triangle), seen.incidence

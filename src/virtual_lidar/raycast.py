"""Casting of rays at a mesh.

The library Embree (through Open3D) finds the triangle that a ray hits, and the plane of the
triangle gives the distance. Embree computes in float32, with errors of about 1e-6 of the
coordinates. Therefore the mesh is first translated to put the sensor at the origin, and distances
are computed again in float64.
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
        (yaw_sine, yaw_cosine), (z, level) = _sine_cosine(rays.yaw), _sine_cosine(rays.pitch)
        x, y = -yaw_sine * level, yaw_cosine * level
        turned = np.moveaxis(poses.rotations, (-2, -1), (0, 1))[..., None]
        rows = [turn[0] * x + turn[1] * y + turn[2] * z for turn in turned]
        directions = np.stack([row.ravel() for row in rows], axis=1)
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
        starts = np.repeat(starts, len(directions) // len(starts), axis=0)
        nearest, triangle = self.met(starts, directions)
        planes = self.planes.take(np.where(np.isfinite(nearest), triangle, 0), axis=0)
        distance, cosine = plane_distances(directions, starts, nearest, planes, limits)
        return Hits(distance, triangle, np.arccos(cosine), self.surfaces).reshaped(shape)


def plane_distances(
    directions: Floats, starts: Floats, nearest: Floats, planes: Floats, limits: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Compute exact distances along rays to the planes that the rays meet.

    Parameters
    ----------
    directions, starts
        Unit vectors and starting points (m) of the rays, (n, 3).
    nearest
        Distances of float32 accuracy, (n,), m; inf for a ray that meets nothing. They are kept for
        rays that are nearly parallel to their planes.
    planes
        Unit normal and distance (m) of the plane that each ray meets, (n, 4).
    limits
        Least and greatest distance of a hit, m.

    Returns
    -------
    distances, cosines
        Distances (n,), m, inf without a hit; and cosines (n,) of the incidence angles, nan without
        a hit.
    """
    cosine = dot(planes, directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (planes[:, 3] - dot(planes, starts)) / cosine
    distance = np.where(np.abs(cosine) > _LEAST_COSINE, distance, nearest)
    is_hit = np.isfinite(nearest) & (distance >= limits[0]) & (distance <= limits[1])
    cosine = np.where(is_hit, np.minimum(np.abs(cosine), 1.0), np.nan)
    return np.where(is_hit, distance, np.inf), cosine


def dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar product of the first three columns in each row of two arrays, (n,)."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _planes_of(mesh: Mesh, origin: Floats) -> Floats:
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    length = np.sqrt(dot(normals, normals))[:, None]
    normals = np.divide(normals, length, out=normals, where=length > 0)
    return np.column_stack([normals, dot(normals, a - origin)])


def _sine_cosine(angles: Floats) -> tuple[Floats, Floats]:
    # Each value of a broadcast array is computed once.
    values = angles[tuple(slice(None) if stride else slice(1) for stride in angles.strides)]
    return np.sin(values), np.cos(values)


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

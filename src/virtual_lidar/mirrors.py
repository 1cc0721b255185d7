from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from virtual_lidar.errors.model import Hits
from virtual_lidar.raycast import Cast, RayCaster

_MOST_MIRRORS = 8
"""Limit of reflections; a path with more has no return."""
_OFF_THE_MIRROR = 1e-4
"""Offset, m, of a reflected ray's start, so that rounding to float32 causes no second hit."""


@dataclass(frozen=True)
class _Paths:
    """Ray paths whose last hit so far is on a mirror, with their last directions."""

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
    """Replace hits on mirrors by hits of the reflected rays.

    `mirrors` (t,) is a mask of triangles. The distance of a hit is the length of the whole path, at
    most `farthest`, m. A ray that meets only mirrors is a miss.
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

"""Distortion as the encoder estimates it: against the points, and against their smoothed samples.

Against smoothed samples, because a decode that reproduces the noise is not nearer to the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from puckbench.geometry.cloud import Floats

_MAX_QUERIES, _MAX_QUICK_QUERIES = 20_000, 8_000
"""Points of each side that are looked up, in a full and in a quick estimate."""


class Distortion(NamedTuple):
    """Mean squared errors, each the mean of both directions.

    point, plane: point-to-point and point-to-plane, to the cloud. surface: to the smoothed samples,
    along their normals; samples are weighted by their shares of the points.
    """

    point: float
    plane: float
    surface: float


@dataclass(frozen=True)
class DistortionEstimator:
    """A cloud (n, 3), its smoothed samples (m, 3), their normals and shares (m,) of the points."""

    points: Floats
    samples: Floats
    normals: Floats
    shares: Floats
    point_tree: Any
    sample_tree: Any

    @classmethod
    def of(
        cls, points: Floats, samples: Floats, normals: Floats, shares: Floats
    ) -> DistortionEstimator:
        """Prepare the search; points and samples should be in a spatial order."""
        return cls(points, samples, normals, shares, _search_tree(points), _search_tree(samples))

    def measure(self, decoded: Floats) -> Distortion:
        """Distortion of decoded points (k, 3), from a subset of each side's."""
        tree = _search_tree(decoded)
        original, made = _subset(self.points, _MAX_QUERIES), _subset(decoded, _MAX_QUERIES)
        forth = original - decoded[tree.query(original)[1]]
        back = made - self.points[self.point_tree.query(made)[1]]
        point, plane = 0.0, 0.0
        for places, vectors in ((original, forth), (made, back)):
            normals = self.normals[self.sample_tree.query(places)[1]]
            point += float(np.mean((vectors**2).sum(axis=1)) / 2)
            plane += float(np.mean((vectors * normals).sum(axis=1) ** 2) / 2)
        return Distortion(point, plane, self._to_surface(decoded, tree, made, _MAX_QUERIES))

    def to_surface(self, decoded: Floats) -> float:
        """Quick estimate of the error of decoded points (k, 3) against the smoothed samples."""
        made = _subset(decoded, _MAX_QUICK_QUERIES)
        return self._to_surface(decoded, _search_tree(decoded), made, _MAX_QUICK_QUERIES)

    def _to_surface(self, decoded: Floats, tree: Any, made: Floats, max_queries: int) -> float:
        arrays = (self.samples, self.normals, self.shares)
        samples, normals, shares = (_subset(values, max_queries) for values in arrays)
        forth = ((samples - decoded[tree.query(samples)[1]]) * normals).sum(axis=1)
        rows = self.sample_tree.query(made)[1]
        back = ((made - self.samples[rows]) * self.normals[rows]).sum(axis=1)
        return float(np.average(forth**2, weights=shares) + np.mean(back**2)) / 2


def _search_tree(points: Floats) -> Any:
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def _subset(points: Floats, count: int) -> Floats:
    """At most `count` rows, at equal steps."""
    return points[:: -(-len(points) // count)]

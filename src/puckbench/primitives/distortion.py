"""Distortion as the encoder estimates it: against the points, and against their smoothed samples.

Against smoothed samples, because a decode that reproduces the noise is not nearer to the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

Ints = NDArray[np.int64]
_LEAF_SIZE = 16
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


class Nearest(NamedTuple):
    """Vectors from the nearest decoded points to points (a, 3) and to smoothed samples (b, 3)."""

    to_points: Floats
    to_samples: Floats

    def or_nearer(self, other: Nearest) -> Nearest:
        """What is nearest among the decoded points of both."""
        return Nearest(*map(_shorter, self, other))


@dataclass(frozen=True)
class DistortionEstimator:
    """A cloud (n, 3), its smoothed samples (m, 3), their normals and shares (m,) of the points.

    normals_of_points: of the samples nearest to the points that are looked up.
    """

    points: Floats
    samples: Floats
    normals: Floats
    shares: Floats
    point_tree: Any
    sample_tree: Any
    normals_of_points: Floats

    @classmethod
    def of(
        cls, points: Floats, samples: Floats, normals: Floats, shares: Floats
    ) -> DistortionEstimator:
        """Prepare the search; points and samples should be in a spatial order."""
        point_tree, sample_tree = search_tree(points), search_tree(samples)
        normals_of_points = normals[sample_tree.query(subset(points, _MAX_QUERIES))[1]]
        trees = (point_tree, sample_tree)
        return cls(points, samples, normals, shares, *trees, normals_of_points)

    def nearest(self, decoded: Floats) -> Nearest:
        """What is nearest among some of the decoded points (k, 3), k > 0."""
        tree = search_tree(decoded)
        subsets = (subset(self.points, _MAX_QUERIES), subset(self.samples, _MAX_QUERIES))
        return Nearest(*(each - decoded[tree.query(each)[1]] for each in subsets))

    def measure(self, decoded: Floats, nearest: Nearest | None = None) -> Distortion:
        """Distortion of decoded points (k, 3), from a subset of each side's.

        nearest: what `self.nearest` finds among them, where it is known; then `subset` of them is
        enough.
        """
        made = subset(decoded, _MAX_QUERIES)
        to_points, to_samples = nearest or self.nearest(decoded)
        rows = self.sample_tree.query(made)[1]
        back = made - self.points[self.point_tree.query(made)[1]]
        point, plane = 0.0, 0.0
        for vectors, normals in ((to_points, self.normals_of_points), (back, self.normals[rows])):
            point += float(np.mean((vectors**2).sum(axis=1)) / 2)
            plane += float(np.mean((vectors * normals).sum(axis=1) ** 2) / 2)
        return Distortion(point, plane, self._to_surface(to_samples, made, rows, _MAX_QUERIES))

    def to_surface(self, decoded: Floats) -> float:
        """Quick estimate of the error of decoded points (k, 3) against the smoothed samples."""
        samples, made = (subset(each, _MAX_QUICK_QUERIES) for each in (self.samples, decoded))
        forth = samples - decoded[search_tree(decoded).query(samples)[1]]
        rows = self.sample_tree.query(made)[1]
        return self._to_surface(forth, made, rows, _MAX_QUICK_QUERIES)

    def _to_surface(self, forth: Floats, made: Floats, rows: Ints, max_queries: int) -> float:
        """Error of vectors from a subset of the samples, and from samples `rows` to made points."""
        normals, shares = (subset(each, max_queries) for each in (self.normals, self.shares))
        forth = (forth * normals).sum(axis=1)
        back = ((made - self.samples[rows]) * self.normals[rows]).sum(axis=1)
        return float(np.average(forth**2, weights=shares) + np.mean(back**2)) / 2


def search_tree(points: Floats) -> Any:
    """A search tree of points (n, 3), n > 0."""
    from pykdtree.kdtree import KDTree

    return KDTree(np.ascontiguousarray(points), leafsize=_LEAF_SIZE)


def subset(rows: NDArray[Any], count: int = _MAX_QUERIES) -> NDArray[Any]:
    """Those of some rows (n, ...), n > 0, that are looked at: at most `count`, at equal steps."""
    return np.ascontiguousarray(rows[:: -(-len(rows) // count)])


def _shorter(a: Floats, b: Floats) -> Floats:
    """The shorter of two vectors each (n, 3)."""
    first = (a**2).sum(axis=1) <= (b**2).sum(axis=1)
    return np.where(first[:, None], a, b)

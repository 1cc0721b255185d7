"""Estimation of a decoded cloud's distortion, by which the encoder compares its candidates.

Decoded points are compared with the points of the cloud, and with smoothed samples of its surface,
which are free of noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from primitive_codec.octree_arrays import Ints

_LEAF_SIZE = 16
_MAX_QUERIES, _MAX_FAST_QUERIES = 20_000, 8_000
"""Largest number of nearest-point queries per direction, in a full and in a fast estimate."""


class Distortion(NamedTuple):
    """Mean squared errors of decoded points.

    The unit of length is 1/1023 of the cloud's longest side.

    Each is the average of two directions: from decoded points to the reference, and back.
    """

    point: float  # point to point, against the cloud
    plane: float  # point to plane, against the cloud
    surface: float  # point to plane, against the smoothed samples weighted by numbers of points


class NearestOffsets(NamedTuple):
    """Vectors from the nearest decoded point to each point and each smoothed sample."""

    of_points: Floats  # (a, 3)
    of_samples: Floats  # (b, 3)

    def nearer(self, other: NearestOffsets) -> NearestOffsets:
        """Return for each point the shorter of the two vectors."""
        return NearestOffsets(*map(_shorter, self, other))


@dataclass(frozen=True)
class DistortionEstimator:
    """Estimates distortions with respect to one cloud, from a subsample of the points.

    All coordinates are in units of 1/1023 of the cloud's longest side.
    """

    points: Floats  # (n, 3)
    samples: Floats  # (m, 3)
    normals: Floats  # (m, 3) of the samples
    weights: Floats  # (m,) fractions of the cloud's points
    point_tree: Any
    sample_tree: Any
    normals_of_points: Floats  # of the samples nearest to the subsampled points

    @classmethod
    def of(
        cls, points: Floats, samples: Floats, normals: Floats, weights: Floats
    ) -> DistortionEstimator:
        """Build an estimator with its search trees.

        Parameters
        ----------
        points
            Points (n, 3) of the cloud.
        samples, normals
            Smoothed samples of the surface and their unit normals (m, 3).
        weights
            Fraction (m,) of the cloud's points that each sample represents.
        """
        point_tree, sample_tree = search_tree(points), search_tree(samples)
        normals_of_points = normals[sample_tree.query(subsample(points))[1]]
        return cls(points, samples, normals, weights, point_tree, sample_tree, normals_of_points)

    def nearest_offsets(self, decoded: Floats) -> NearestOffsets:
        """Find the decoded point nearest to each point and sample, among points (k, 3)."""
        tree = search_tree(decoded)
        queries = (subsample(self.points), subsample(self.samples))
        return NearestOffsets(*(xyz - decoded[tree.query(xyz)[1]] for xyz in queries))

    def measure(self, decoded: Floats, offsets: NearestOffsets | None = None) -> Distortion:
        """Estimate the distortion of decoded points.

        Parameters
        ----------
        decoded
            Coordinates (k, 3); if `offsets` is given, a `subsample` of the decoded points suffices.
        offsets
            The `nearest_offsets` of all decoded points; by default they are computed.
        """
        queries = subsample(decoded)
        of_points, of_samples = offsets or self.nearest_offsets(decoded)
        rows = self.sample_tree.query(queries)[1]
        of_decoded = queries - self.points[self.point_tree.query(queries)[1]]
        directions = ((of_points, self.normals_of_points), (of_decoded, self.normals[rows]))
        point, plane = 0.0, 0.0
        for vectors, normals in directions:
            point += float(np.mean((vectors**2).sum(axis=1)) / 2)
            plane += float(np.mean((vectors * normals).sum(axis=1) ** 2) / 2)
        return Distortion(point, plane, self._surface_error(of_samples, queries, rows))

    def surface_error(self, decoded: Floats) -> float:
        """Estimate only the error `surface` of decoded points (k, 3), from fewer points."""
        samples, queries = (subsample(xyz, _MAX_FAST_QUERIES) for xyz in (self.samples, decoded))
        of_samples = samples - decoded[search_tree(decoded).query(samples)[1]]
        rows = self.sample_tree.query(queries)[1]
        return self._surface_error(of_samples, queries, rows, _MAX_FAST_QUERIES)

    def _surface_error(
        self, of_samples: Floats, queries: Floats, rows: Ints, max_queries: int = _MAX_QUERIES
    ) -> float:
        normals, weights = (subsample(array, max_queries) for array in (self.normals, self.weights))
        of_samples = (of_samples * normals).sum(axis=1)
        of_queries = ((queries - self.samples[rows]) * self.normals[rows]).sum(axis=1)
        return float(np.average(of_samples**2, weights=weights) + np.mean(of_queries**2)) / 2


def search_tree(points: Floats) -> Any:
    """Return a k-d tree of points (n, 3) for queries of nearest points."""
    from pykdtree.kdtree import KDTree

    return KDTree(np.ascontiguousarray(points), leafsize=_LEAF_SIZE)


def subsample(rows: NDArray[Any], max_count: int = _MAX_QUERIES) -> NDArray[Any]:
    """Return every k-th row, with the smallest k that leaves at most `max_count` rows."""
    return np.ascontiguousarray(rows[:: -(-len(rows) // max_count)])


def _shorter(a: Floats, b: Floats) -> Floats:
    is_first = (a**2).sum(axis=1) <= (b**2).sum(axis=1)
    return np.where(is_first[:, None], a, b)

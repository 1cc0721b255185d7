"""How far a decode is from a cloud, as an encoder can tell: by some points, less the noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from puckbench.geometry.cloud import Floats

_QUERIES, _QUICK = 20_000, 8_000
"""Points of each side that are looked up, and for a quick estimate."""


class Errors(NamedTuple):
    """Mean squared errors of both directions.

    point, plane: to the cloud. surface: to its smoothed samples, along their normals; these count
    by their shares of the points, as the points do in the first direction of any measure of them.
    """

    point: float
    plane: float
    surface: float


@dataclass(frozen=True)
class Judge:
    """A cloud (n, 3), its smoothed samples (m, 3), their normals and shares of the points."""

    points: Floats
    samples: Floats
    normals: Floats
    shares: Floats
    by_point: Any
    by_sample: Any

    @classmethod
    def of(cls, points: Floats, samples: Floats, normals: Floats, shares: Floats) -> Judge:
        """Prepare the search; points and samples in an order that has neighbours together."""
        return cls(points, samples, normals, shares, _searchable(points), _searchable(samples))

    def errors(self, decoded: Floats) -> Errors:
        """Errors of decoded points (k, 3), from some of each side's."""
        near = _searchable(decoded)
        chosen, made = _some(self.points, _QUERIES), _some(decoded, _QUERIES)
        forth = chosen - decoded[near.query(chosen)[1]]
        back = made - self.points[self.by_point.query(made)[1]]
        point, plane = 0.0, 0.0
        for places, vectors in ((chosen, forth), (made, back)):
            along = self.normals[self.by_sample.query(places)[1]]
            point += float(np.mean((vectors**2).sum(axis=1)) / 2)
            plane += float(np.mean((vectors * along).sum(axis=1) ** 2) / 2)
        return Errors(point, plane, self._to_surface(decoded, near, made, _QUERIES))

    def to_surface(self, decoded: Floats) -> float:
        """Error of decoded points (k, 3) against the smoothed samples."""
        return self._to_surface(decoded, _searchable(decoded), _some(decoded, _QUICK), _QUICK)

    def _to_surface(self, decoded: Floats, near: Any, made: Floats, most: int) -> float:
        seen = (self.samples, self.normals, self.shares)
        samples, normals, shares = (_some(values, most) for values in seen)
        forth = ((samples - decoded[near.query(samples)[1]]) * normals).sum(axis=1)
        rows = self.by_sample.query(made)[1]
        back = ((made - self.samples[rows]) * self.normals[rows]).sum(axis=1)
        return float(np.average(forth**2, weights=shares) + np.mean(back**2)) / 2


def _searchable(points: Floats) -> Any:
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def _some(points: Floats, most: int) -> Floats:
    """Rows at equal steps, at most `most`."""
    return points[:: -(-len(points) // most)]

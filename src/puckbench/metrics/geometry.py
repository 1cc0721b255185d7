"""D1 and D2, Chamfer and Hausdorff distances (thesis section 2.4, equations 2.3 to 2.6).

Duplicate points, missing normals and equidistant neighbours are treated as in MPEG's pc_error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud, check_points
from pointkit.geometry.spatial_order import Rows, distinct_points
from puckbench.geometry.neighbours import Neighbours, SearchablePoints
from puckbench.metrics.diameter import diameter
from puckbench.metrics.lossless import rounding

CODE = (
    "puckbench.geometry.neighbours",
    "puckbench.geometry.box_search",
    "puckbench.metrics.diameter",
)

_QUANTILE = 0.99


@dataclass(frozen=True)
class SquaredErrors:
    """Squared point-to-point and point-to-plane errors between two clouds.

    ``ab_...`` (n,) are from the distinct points of the reference A to the decoded cloud B,
    ``ba_...`` (m,) from the distinct points of B, `decoded` (m, 3), to A.
    """

    decoded: Floats
    ab_point: Floats
    ba_point: Floats
    ab_plane: Floats | None = None
    ba_plane: Floats | None = None


class DistinctPoints:
    """The distinct points of a cloud (n, 3) with a reusable search index."""

    def __init__(self, points: Floats, what: str = "decoded cloud") -> None:
        check_points(points, what)
        self.rows, self.xyz = distinct_points(_float64(points))
        self.search = SearchablePoints(self.xyz)

    @classmethod
    def of(cls, decoded: Floats | DistinctPoints) -> DistinctPoints:
        return decoded if isinstance(decoded, cls) else cls(cast(Floats, decoded))


class ReferenceCloud:
    """A reference cloud with reusable search index and checked normals."""

    def __init__(self, cloud: PointCloud) -> None:
        self.cloud = cloud
        self.points = DistinctPoints(cloud.xyz, "reference cloud")
        self.normals: Floats | None = None
        if cloud.normals is not None:
            self.normals = _checked_normals(cloud).take(self.points.rows, axis=0)

    @classmethod
    def of(cls, reference: PointCloud | ReferenceCloud) -> ReferenceCloud:
        return reference if isinstance(reference, cls) else cls(cast(PointCloud, reference))

    @cached_property
    def diameter(self) -> float:
        """The largest distance between points, from the cloud's description or computed."""
        return float(self.cloud.about.get("diameter") or diameter(self.cloud.xyz))

    @cached_property
    def rounding(self) -> float:
        return rounding(self.cloud)


def distortion(
    reference: PointCloud | ReferenceCloud, decoded: Floats | DistinctPoints
) -> dict[str, float]:
    """Return D1, D2, Chamfer and Hausdorff distances, as in MPEG's pc_error.

    Duplicate points count once, with the normal of the first. Decoded points get normals by
    `transfer_normals`. Point-to-plane errors are projected onto the nearest neighbour's normal;
    squared errors are averaged over equidistant neighbours.

    Parameters
    ----------
    reference
        The original cloud (A).
    decoded
        The decoded cloud (B), (m, 3), in the coordinate frame of A.

    Returns
    -------
    dict
        In squared units of the clouds, except ``hausdorff_...`` and ``q99_...`` (units):

        * ``acd_ab_point``, ``acd_ba_point``: asymmetric Chamfer distances (eq. 2.3); ``cd_point``:
          their mean (eq. 2.4); ``d1_mse``: their maximum (pc_error's mseF).
        * ``hausdorff_point``: Hausdorff distance (eq. 2.5); ``hausdorff_sq_point``: its square
          (pc_error's "h."). ``q99_point``: the larger of both directions' 99 % quantiles.
        * ``..._plane`` and ``d2_mse``: the point-to-plane versions (eq. 2.6), if the reference has
          normals.
        * ``points_a``, ``points_b``: numbers of distinct points.
    """
    return summarise_errors(squared_errors(reference, decoded))


def squared_errors(
    reference: PointCloud | ReferenceCloud, decoded: Floats | DistinctPoints
) -> SquaredErrors:
    """Return the squared errors that `distortion` summarises."""
    reference = ReferenceCloud.of(reference)
    from_a, from_b = reference.points, DistinctPoints.of(decoded)
    a, b = from_a.xyz, from_b.xyz
    ab, ba = from_b.search.nearest(from_a.search), from_a.search.nearest(from_b.search)
    normals = reference.normals
    if normals is None:
        return SquaredErrors(b, ab.squared, ba.squared)
    normals_b = transfer_normals(normals, len(b), ab, ba)
    return SquaredErrors(
        b,
        ab.squared,
        ba.squared,
        _projected(a, b, normals_b, ab),
        _projected(b, a, normals, ba),
    )


def summarise_errors(errors: SquaredErrors) -> dict[str, float]:
    values = _summary(errors.ab_point, errors.ba_point, "point", "d1_mse")
    if errors.ab_plane is not None and errors.ba_plane is not None:
        values |= _summary(errors.ab_plane, errors.ba_plane, "plane", "d2_mse")
    return values | {"points_a": len(errors.ab_point), "points_b": len(errors.ba_point)}


def _summary(ab: Floats, ba: Floats, kind: str, largest_mse: str) -> dict[str, float]:
    acd_ab, acd_ba = float(ab.mean()), float(ba.mean())
    largest = float(max(ab.max(), ba.max()))
    return {
        f"acd_ab_{kind}": acd_ab,
        f"acd_ba_{kind}": acd_ba,
        f"cd_{kind}": (acd_ab + acd_ba) / 2,
        largest_mse: max(acd_ab, acd_ba),
        f"q99_{kind}": max(_quantile(ab), _quantile(ba)) ** 0.5,
        f"hausdorff_{kind}": largest**0.5,
        f"hausdorff_sq_{kind}": largest,
    }


def _quantile(squared: Floats) -> float:
    """Return the smallest value (n,) that at least 99 % of the values do not exceed."""
    rank = math.ceil(_QUANTILE * len(squared)) - 1
    return float(np.partition(squared, rank)[rank])


def _float64(values: NDArray[Any]) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)


def _checked_normals(reference: PointCloud) -> Floats:
    normals = _float64(np.asarray(reference.normals))
    if not np.isfinite(normals).all():
        raise InputError("reference cloud: a normal is not finite")
    return normals


def transfer_normals(normals: Floats, size: int, ab: Neighbours, ba: Neighbours) -> Floats:
    """Return normals (size, 3) of the decoded cloud B from those of the reference A (n, 3).

    As in pc_error, the normal of a point b in B is the mean, not normalised, over all points of A
    whose nearest neighbour is b or, without such points, over b's nearest neighbours in A. `ab` are
    the neighbours in B of points of A; `ba` are those in A of points of B.
    """
    takers, sources = _exact_pairs(ab)
    to_b = np.bincount(sources, minlength=size) == 0
    queries, nearest = _exact_pairs(ba)
    is_left = to_b[queries]
    rows = np.concatenate([sources, queries[is_left]])
    taken = normals.take(np.concatenate([takers, nearest[is_left]]), axis=0)
    sums = [np.bincount(rows, column, size) for column in taken.T]
    return np.stack(sums, axis=1) / np.bincount(rows, minlength=size)[:, None]


def _exact_pairs(neighbours: Neighbours) -> tuple[Rows, Rows]:
    """Return query and nearest neighbour of all pairs at exactly the least distance."""
    first = neighbours.starts[:-1]
    queries = np.repeat(np.arange(len(first)), np.diff(neighbours.starts))
    is_exact = np.arange(len(queries)) - first[queries] < neighbours.exact[queries]
    return queries[is_exact], neighbours.index[is_exact]


def _projected(queries: Floats, points: Floats, normals: Floats, nearest: Neighbours) -> Floats:
    counts = np.diff(nearest.starts)
    rows = np.repeat(np.arange(len(queries)), counts)
    offsets = queries.take(rows, axis=0) - points.take(nearest.index, axis=0)
    offsets *= normals.take(nearest.index, axis=0)
    along = offsets[:, 0] + offsets[:, 1] + offsets[:, 2]
    return np.bincount(rows, along * along, len(queries)) / counts

"""Geometric errors of a decoded cloud: D1 and D2, Chamfer and Hausdorff distances.

Section 2.4 of the thesis defines them (equations 2.3 to 2.6). Duplicate points, missing normals and
equidistant neighbours are treated as in MPEG's program pc_error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
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
    """The squared distances between a reference cloud A and a decoded cloud B, point by point.

    Duplicate points of both clouds are removed before.

    Parameters
    ----------
    decoded
        Distinct points (m, 3) of B.
    ab_point, ba_point
        Squared distances (n,) of the points of A to their nearest points of B, and (m,) of B to A.
    ab_plane, ba_plane
        The same distances along the normals of the nearest points; None without normals.
    """

    decoded: Floats
    ab_point: Floats
    ba_point: Floats
    ab_plane: Floats | None = None
    ba_plane: Floats | None = None


class DistinctPoints:
    """The distinct points of a cloud, with a search index that several comparisons can share.

    `xyz` (n, 3) are the points, `rows` (n,) their indices in the cloud, and `search` is the index.
    """

    def __init__(self, points: Floats, what: str = "decoded cloud") -> None:
        check_points(points, what)
        self.rows, self.xyz = distinct_points(_float64(points))
        self.search = SearchablePoints(self.xyz)

    @classmethod
    def of(cls, decoded: Floats | DistinctPoints) -> DistinctPoints:
        """Return `decoded` itself if it is prepared already, else prepare points (m, 3)."""
        return decoded if isinstance(decoded, cls) else cls(cast(Floats, decoded))


class ReferenceCloud:
    """A reference cloud, prepared so that many decoded clouds can be compared with it.

    It holds the search index of the distinct points and the checked normals. InputError is raised
    if the cloud is empty or a normal is not finite.
    """

    def __init__(self, cloud: PointCloud) -> None:
        self.cloud = cloud
        self.points = DistinctPoints(cloud.xyz, "reference cloud")
        self.normals: Floats | None = None
        if cloud.normals is not None:
            self.normals = _checked_normals(cloud).take(self.points.rows, axis=0)

    @classmethod
    def of(cls, reference: PointCloud | ReferenceCloud) -> ReferenceCloud:
        """Return `reference` unchanged if it is prepared already, else prepare it."""
        return reference if isinstance(reference, cls) else cls(cast(PointCloud, reference))

    @cached_property
    def diameter(self) -> float:
        """The largest distance between two points, from ``about["diameter"]`` if it is known."""
        return float(self.cloud.about.get("diameter") or diameter(self.cloud.xyz))

    @cached_property
    def rounding(self) -> float:
        """The largest error that rounding of coordinates can cause, in units of the cloud."""
        return rounding(self.cloud)


def distortion(
    reference: PointCloud | ReferenceCloud, decoded: Floats | DistinctPoints
) -> dict[str, float]:
    """Return the D1, D2, Chamfer and Hausdorff distances of a decoded cloud, as in MPEG's pc_error.

    Duplicate points count once, with the normal of the first. Decoded points get normals from the
    reference by `transfer_normals`. A point-to-plane error is the offset to the nearest neighbour,
    projected onto the neighbour's normal. Squared errors are averaged over equidistant neighbours.

    Parameters
    ----------
    reference
        The original cloud (A).
    decoded
        Points (m, 3) of the decoded cloud (B), in the coordinate frame of A.

    Returns
    -------
    dict
        Values are in squared units of the clouds, except ``hausdorff_...`` and ``q99_...`` (units):

        * ``acd_ab_point``, ``acd_ba_point``: asymmetric Chamfer distances from A to B and from B to
          A (eq. 2.3).
        * ``cd_point``: mean of both Chamfer distances (eq. 2.4).
        * ``d1_mse``: maximum of both Chamfer distances (pc_error's mseF).
        * ``hausdorff_point``: Hausdorff distance (eq. 2.5).
        * ``hausdorff_sq_point``: squared Hausdorff distance (pc_error's "h.").
        * ``q99_point``: 99 % quantile of the distances, the larger of both directions.
        * ``..._plane`` and ``d2_mse``: the point-to-plane versions (eq. 2.6), if the reference has
          normals.
        * ``points_a``, ``points_b``: numbers of distinct points.
    """
    return summarise_errors(squared_errors(reference, decoded))


def squared_errors(
    reference: PointCloud | ReferenceCloud, decoded: Floats | DistinctPoints
) -> SquaredErrors:
    """Return the squared errors between two clouds, one for each distinct point.

    `summarise_errors` makes metrics from them.

    Parameters
    ----------
    reference
        The original cloud (A).
    decoded
        Points (m, 3) of the decoded cloud (B), in the coordinate frame of A.
    """
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
        _projected(a, b, normals_b, ab.starts, ab.index),
        _projected(b, a, normals, ba.starts, ba.index),
    )


def summarise_errors(errors: SquaredErrors) -> dict[str, float]:
    """Return the metrics that `distortion` describes, computed from point-wise squared errors."""
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
    """Return the smallest of the values (n,) that at least 99 % of them do not exceed."""
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
    """Return normals (size, 3) for the points of a decoded cloud B, taken from a reference A.

    As in pc_error, the normal of a point b is the mean of the normals of all points of A whose
    nearest neighbour is b. If there are none, it is the mean over the nearest neighbours of b in A.
    The mean is not normalised.

    Parameters
    ----------
    normals
        Normals (n, 3) of the points of A.
    size
        Number of points of B.
    ab
        The nearest neighbours in B of the points of A.
    ba
        The nearest neighbours in A of the points of B.
    """
    sums, counts = np.zeros((size, 3)), np.zeros(size, np.int64)
    _add_to_nearest(normals, ab.starts, ab.exact, ab.index, sums, counts)
    _add_nearest(normals, ba.starts, ba.exact, ba.index, sums, counts)
    sums /= counts[:, None]
    return sums


@compiled
def _add_to_nearest(
    normals: Floats, starts: Rows, exact: Rows, index: Rows, sums: Floats, counts: Rows
) -> None:
    """Add the normal of each point of A to the points of B at exactly the least distance."""
    for i in range(len(exact)):
        for pair in range(starts[i], starts[i] + exact[i]):
            for axis in range(3):
                sums[index[pair], axis] += normals[i, axis]
            counts[index[pair]] += 1


@compiled
def _add_nearest(
    normals: Floats, starts: Rows, exact: Rows, index: Rows, sums: Floats, counts: Rows
) -> None:
    """Add the normals of the nearest points of A to the points of B that have none yet.

    `sums` (n, 3) and `counts` (n,) are the sums of normals for each point of B, and their numbers.
    """
    for i in range(len(exact)):
        if counts[i] == 0:
            for pair in range(starts[i], starts[i] + exact[i]):
                for axis in range(3):
                    sums[i, axis] += normals[index[pair], axis]
            counts[i] = exact[i]


@compiled
def _projected(
    queries: Floats, points: Floats, normals: Floats, starts: Rows, index: Rows
) -> Floats:
    """Return the squared distance from each query to the planes of its nearest points, (n,).

    The plane of a point is normal to the point's normal. With several nearest points, the result is
    the mean over them. The unit is the square of that of the coordinates.
    """
    means = np.empty(len(queries))
    for i in range(len(queries)):
        total = 0.0
        for pair in range(starts[i], starts[i + 1]):
            along = 0.0
            for axis in range(3):
                offset = queries[i, axis] - points[index[pair], axis]
                along += offset * normals[index[pair], axis]
            total += along * along
        means[i] = total / (starts[i + 1] - starts[i])
    return means

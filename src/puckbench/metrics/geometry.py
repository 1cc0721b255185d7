"""Distortion of a decoded cloud: Chamfer and Hausdorff distances, point to point and to plane.

Thesis section 2.4, equations 2.3 to 2.6, with the rules of MPEG's pc_error for what the equations
leave open: duplicates, points without normals, equidistant neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, PointCloud, check_points
from puckbench.geometry.neighbours import Neighbours, SearchablePoints
from puckbench.geometry.spatial_order import Rows, distinct_points
from puckbench.metrics.diameter import diameter
from puckbench.metrics.lossless import rounding


@dataclass(frozen=True)
class SquaredErrors:
    """Squared errors of the points of two clouds, reference (A) and decoded (B).

    Parameters
    ----------
    decoded
        Distinct points of B, (m, 3), that ``ba_point`` and ``ba_plane`` belong to.
    ab_point, ba_point
        Point to point, (n,) from A to B and (m,) from B to A, squared units of the clouds.
    ab_plane, ba_plane
        Point to plane, likewise; None when the reference has no normals.
    """

    decoded: Floats
    ab_point: Floats
    ba_point: Floats
    ab_plane: Floats | None = None
    ba_plane: Floats | None = None


class DistinctPoints:
    """The distinct points of a cloud, sorted and made ready for searches once.

    Whatever takes decoded points takes them like this too, so that several comparisons share them.

    Parameters
    ----------
    points
        (n, 3), in any order.
    what
        Their name in messages.

    Raises
    ------
    InputError
        There are none, or some that are not finite.
    """

    def __init__(self, points: Floats, what: str = "decoded cloud") -> None:
        check_points(points, what)
        self.rows, self.xyz = distinct_points(_float64(points))
        self.search = SearchablePoints(self.xyz)

    @classmethod
    def of(cls, decoded: Floats | DistinctPoints) -> DistinctPoints:
        """The points themselves, or a decoded cloud made ready."""
        return decoded if isinstance(decoded, cls) else cls(cast(Floats, decoded))


class Reference:
    """A reference cloud (A), made ready once for all decoded clouds that are compared with it.

    Its distinct points are sorted and searched, its normals checked. Whatever takes a reference
    takes it as a `PointCloud` too, and then makes it ready for one decoded cloud.

    Parameters
    ----------
    cloud
        The original cloud, with normals for the distances to plane.

    Raises
    ------
    InputError
        The cloud is empty or has values that are not finite.
    """

    def __init__(self, cloud: PointCloud) -> None:
        self.cloud = cloud
        self.points = DistinctPoints(cloud.xyz, "reference cloud")
        self.normals: Floats | None = None
        if cloud.normals is not None:
            self.normals = _checked_normals(cloud).take(self.points.rows, axis=0)

    @classmethod
    def of(cls, reference: PointCloud | Reference) -> Reference:
        """The reference itself, or a cloud made ready."""
        return reference if isinstance(reference, cls) else cls(cast(PointCloud, reference))

    @cached_property
    def diameter(self) -> float:
        """Of the cloud, in its unit: as its description says, or else measured."""
        return float(self.cloud.about.get("diameter") or diameter(self.cloud.xyz))

    @cached_property
    def rounding(self) -> float:
        """Errors up to this are those of the rounding of numbers, in the cloud's unit."""
        return rounding(self.cloud)


def distortion(
    reference: PointCloud | Reference, decoded: Floats | DistinctPoints
) -> dict[str, float]:
    """Chamfer and Hausdorff distances of a decoded cloud, as MPEG's pc_error measures them.

    Points with equal coordinates are merged first; the first one's normal stays. B's normals come
    from A's: see `transferred_normals`. Point to plane, an error vector is projected on the normal
    of the neighbour that it leads to; equidistant neighbours count with their mean.

    All is in double precision, while pc_error rounds coordinates to single as it reads them: the
    two agree to 1e-6 on coordinates that single precision holds, to some 1e-5 on others.

    Parameters
    ----------
    reference
        The original cloud (A), with normals for the distances to plane; as a `Reference` where
        several decoded clouds are measured.
    decoded
        Coordinates (m, 3) of the decoded cloud (B), in the frame of A; as `DistinctPoints` where
        it is compared with several clouds.

    Returns
    -------
    dict
        In squared units of the clouds but for the Hausdorff distances (units):

        * ``acd_ab_point``, ``acd_ba_point``: the two asymmetric Chamfer distances (eq. 2.3),
          ``cd_point``: their mean (eq. 2.4), ``d1_mse``: their maximum (pc_error's mseF),
        * ``hausdorff_point``: Hausdorff distance (eq. 2.5), ``hausdorff_sq_point``: its square
          (pc_error's "h."),
        * the same with ``_plane`` for ``_point`` and ``d2_mse`` for ``d1_mse`` (eq. 2.6), when the
          reference has normals,
        * ``points_a``, ``points_b``: numbers of distinct points.

    Raises
    ------
    InputError
        A cloud is empty or has values that are not finite.

    References
    ----------
    Thesis, section 2.4; ISO/IEC JTC1/SC29/WG11, mpeg-pcc-dmetric (pc_error).
    """
    return summary(squared_errors(reference, decoded))


def squared_errors(
    reference: PointCloud | Reference, decoded: Floats | DistinctPoints
) -> SquaredErrors:
    """Squared error of every distinct point of both clouds, as `distortion` defines it."""
    reference = Reference.of(reference)
    from_a, from_b = reference.points, DistinctPoints.of(decoded)
    a, b = from_a.xyz, from_b.xyz
    ab, ba = from_b.search.nearest(from_a.search), from_a.search.nearest(from_b.search)
    normals = reference.normals
    if normals is None:
        return SquaredErrors(b, ab.squared, ba.squared)
    normals_b = transferred_normals(normals, len(b), ab, ba)
    return SquaredErrors(
        b,
        ab.squared,
        ba.squared,
        _projected(a, b, normals_b, ab.starts, ab.index),
        _projected(b, a, normals, ba.starts, ba.index),
    )


def summary(errors: SquaredErrors) -> dict[str, float]:
    """The measures of `distortion` from the squared errors of the points."""
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
        f"hausdorff_{kind}": largest**0.5,
        f"hausdorff_sq_{kind}": largest,
    }


def _float64(values: NDArray[Any]) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)


def _checked_normals(reference: PointCloud) -> Floats:
    normals = _float64(np.asarray(reference.normals))
    if normals.shape != reference.xyz.shape:
        raise InputError(f"reference cloud: {len(normals)} normals for {len(reference)} points")
    if not np.isfinite(normals).all():
        raise InputError("reference cloud: a normal is not finite")
    return normals


def transferred_normals(normals: Floats, size: int, ab: Neighbours, ba: Neighbours) -> Floats:
    """Normals (size, 3) of B from those of A (n, 3), by MPEG's rule.

    A point of B gets the plain mean, not made unit again, of the normals of the points of A that
    have it as a nearest neighbour, equidistant ones included; where there are none, the mean of
    its own nearest neighbours' normals.
    """
    sums, counts = _sums_of_takers(normals, size, ab.starts, ab.exact, ab.index)
    _add_own_nearest(normals, ba.starts, ba.exact, ba.index, sums, counts)
    return np.asarray(sums / counts[:, None])


@compiled
def _sums_of_takers(
    normals: Floats, size: int, starts: Rows, exact: Rows, index: Rows
) -> tuple[Floats, Floats]:
    sums, counts = np.zeros((size, 3)), np.zeros(size)
    for i in range(len(normals)):
        for j in range(starts[i], starts[i] + exact[i]):
            counts[index[j]] += 1
            for axis in range(3):
                sums[index[j], axis] += normals[i, axis]
    return sums, counts


@compiled
def _add_own_nearest(
    normals: Floats, starts: Rows, exact: Rows, index: Rows, sums: Floats, counts: Floats
) -> None:
    for i in range(len(counts)):
        if counts[i] > 0:
            continue
        for j in range(starts[i], starts[i] + exact[i]):
            counts[i] += 1
            for axis in range(3):
                sums[i, axis] += normals[index[j], axis]


@compiled
def _projected(
    queries: Floats, points: Floats, normals: Floats, starts: Rows, index: Rows
) -> Floats:
    """Squared errors along the neighbours' normals, (m,): the mean over equidistant neighbours."""
    squared = np.zeros(len(queries))
    for i in range(len(queries)):
        for j in range(starts[i], starts[i + 1]):
            n = index[j]
            along = 0.0
            for axis in range(3):
                along += (queries[i, axis] - points[n, axis]) * normals[n, axis]
            squared[i] += along * along
        squared[i] /= starts[i + 1] - starts[i]
    return squared

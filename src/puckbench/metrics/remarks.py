"""Remarks on results that look wrong: lost points, a wrong step, rates that are out of order.

They judge by distances. A cloud on a coarse grid has few points, and yet a point near each point of
the original.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats, bounds
from puckbench.geometry.matching import share_beyond

if TYPE_CHECKING:
    from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud

CODE = ("puckbench.geometry.matching",)

_OFF = 0.1
"""Root mean square error of a decoded cloud, as a share of the diameter, that calls for a remark.

At the lowest rates of the benchmark's codecs, it is at most 0.034.
"""
_FAR = 5.0
"""A point is lost if it is farther from every decoded point than this many times the error of the
decoded points, and the spacing of the original, ..."""
_SPARSE = 3.0
"""... and this many times the spacing of the decoded points, which on a grid is its step."""
_LOST = 0.1
"""Share of lost points that calls for a remark."""
_RISE, _FALL = 1.5, 0.95
"""Increase of the error, and decrease of the bytes, from one rate to the next that call for a
remark. With scales between powers of two, the error of a correct octree increases by up to 1.3."""


def remark_on(
    reference: ReferenceCloud, decoded: DistinctPoints, errors: Mapping[str, float]
) -> str | None:
    """Return a line on a decoded cloud that looks wrong, or None.

    It looks wrong if it is off by more than a tenth of the diameter, or if a tenth of the points of
    the original are lost: no decoded point is near them, although decoded points are near the
    original. A coarse grid has a point within its step of each.

    Parameters
    ----------
    reference, decoded
        The original and the decoded cloud, in one coordinate frame.
    errors
        Result of `puckbench.metrics.cloud_metrics.geometry_metrics` for the two clouds.
    """
    points, own = reference.points.xyz, errors["acd_ba_point"] ** 0.5
    off = errors["d1_mse"] ** 0.5
    is_off = off > _OFF * reference.diameter
    if len(points) == 1 or not (is_off or errors["q99_point"] > _FAR * own):
        return None
    step = float(np.quantile(_to_nearest(decoded.xyz), 0.05, method="lower"))
    if is_off and off > step:
        wide = _width(decoded.xyz) / _width(points)
        return (
            f"the decoded cloud is off by {off / reference.diameter:.0%} of the diameter, and "
            f"{wide:.2g} times as wide: its step or origin is wrong, or points are lost"
        )
    reach = max(_FAR * own, _FAR * float(_to_nearest(points).mean()), _SPARSE * step)
    lost = share_beyond(points, decoded.xyz, reach)
    if lost <= _LOST:
        return None
    unit = " m" if reference.cloud.frame == "metric" else ""
    return f"{lost:.0%} of the points are lost: no decoded point is within {reach:.3g}{unit}"


def _to_nearest(points: Floats) -> Floats:
    """Return the distance of each of distinct points (n, 3) from the nearest other one, (n,)."""
    from pykdtree.kdtree import KDTree

    if len(points) < 2:
        return np.full(len(points), np.inf)
    near = points - points[0]
    distances: Floats = KDTree(near).query(near, k=2)[0][:, 1]
    return distances


def _width(points: Floats) -> float:
    low, high = bounds(points)
    return float((high - low).max())


def order_remarks(rows: Sequence[Mapping[str, Any]]) -> list[str | None]:
    """Return, for each row of a rate-distortion curve, what is out of order, or None.

    From one row to the next, the bytes must grow, and the errors must not. A row that breaks this
    gets a line of text.

    Parameters
    ----------
    rows
        Rows of results of one cloud and codec, the smallest bitrate first, with the columns
        ``rate``, ``bytes`` and ``d1_mse``.
    """
    return [None, *(_out_of_order(*pair) for pair in pairwise(rows))][: len(rows)]


def _out_of_order(before: Mapping[str, Any], row: Mapping[str, Any]) -> str | None:
    other = before.get("rate", "the rate before")
    if row["bytes"] < _FALL * before["bytes"]:
        return f"fewer bytes than {other}: {row['bytes']:,} of {before['bytes']:,}"
    errors = [each["d1_mse"] ** 0.5 for each in (before, row)]
    if errors[1] <= _RISE * errors[0]:
        return None
    return f"a larger error than {other}: {errors[1]:.3g} after {errors[0]:.3g}"

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

_SLACK = 1 + 1e-6
_ORDER_SLACK = 0.25
"""Share of the reach by which, through rounding, another decoded point may be nearer."""


class Match(NamedTuple):
    """Original points of decoded points.

    Parameters
    ----------
    rows
        (m,) index of each decoded point's original point; -1 if none lies within `reach`.
    by
        Whether points were matched by order or by position.
    unused
        Number of original points that match no decoded point.
    reach
        Largest distance of a decoded point from its original.
    """

    rows: NDArray[np.int64]
    by: Literal["order", "position"]
    unused: int
    reach: float

    @property
    def unmatched(self) -> int:
        """Number of decoded points without an original point."""
        return int(np.count_nonzero(self.rows < 0))


def match_points(original: Floats, decoded: Floats, reach: float | None = None) -> Match:
    """Find the original point from which each decoded point takes its attributes.

    If both clouds have equally many points, and all pairs with equal index lie within `reach` and
    about as near as the nearest decoded point, points match by index. Otherwise each original point
    belongs to the nearest decoded position. The k decoded points at a position match the (up to k)
    nearest of its original points; remaining decoded points match the nearest original point within
    `reach`.

    Parameters
    ----------
    original, decoded
        Points (n, 3) and (m, 3), at least one of each.
    reach
        Largest distance of a decoded point from its original; by default the largest distance of an
        original point from the nearest decoded point.
    """
    from pykdtree.kdtree import KDTree

    corner = original.min(axis=0)
    original, decoded = original - corner, decoded - corner
    places, place, copies = np.unique(decoded, axis=0, return_inverse=True, return_counts=True)
    distances, nearest = KDTree(places).query(original)
    reach = float(distances.max() if reach is None else reach) * _SLACK
    if len(original) == len(decoded):
        errors = np.linalg.norm(decoded - original, axis=1)
        if (errors <= np.minimum(reach, distances + _ORDER_SLACK * reach)).all():
            return Match(np.arange(len(decoded)), "order", 0, reach)
    rows = np.full(len(decoded), -1)
    near = np.flatnonzero(distances <= reach)
    near = near[np.lexsort((distances[near], nearest[near]))]
    counts = np.bincount(nearest[near], minlength=len(places))
    order = np.argsort(place, kind="stable")
    rank = np.arange(len(decoded)) - np.repeat(np.cumsum(copies) - copies, copies)
    has = rank < np.repeat(counts, copies)
    first = np.repeat(np.cumsum(counts) - counts, copies)
    rows[order[has]] = near[(first + rank)[has]]
    left = np.flatnonzero(rows < 0)
    if len(left):
        distances, nearest = KDTree(original).query(decoded[left])
        rows[left] = np.where(distances <= reach, nearest.astype(np.int64), -1)
    used = len(np.unique(rows[rows >= 0]))
    return Match(rows, "position", len(original) - used, reach)


def farthest(points: Floats, decoded: Floats) -> float:
    """Return the largest distance of points (n, 3) from the nearest of decoded points (m, 3)."""
    return float(_distances(points, decoded).max())


def share_beyond(points: Floats, others: Floats, distance: float) -> float:
    """Return the share of points (n, 3) with none of the other points (m, 3) within a distance."""
    return float(np.mean(_distances(points, others) > distance))


def _distances(points: Floats, others: Floats) -> Floats:
    from pykdtree.kdtree import KDTree

    corner = others.min(axis=0)
    distances: Floats = KDTree(others - corner).query(points - corner)[0]
    return distances

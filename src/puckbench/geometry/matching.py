from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

_SLACK = 1 + 1e-6
_ORDER_SLACK = 0.25
"""Share of the reach by which another decoded point may be nearer than the one of equal index."""


class Match(NamedTuple):
    """The original point that belongs to each of m decoded points, as `match_points` finds them.

    Parameters
    ----------
    rows
        Index of each decoded point's original point, (m,); -1 if none lies within `reach`.
    by
        Whether points were matched by their order in both clouds, or by their positions.
    unused
        Number of original points that belong to no decoded point.
    reach
        Largest distance that was allowed between a decoded point and its original point.
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

    Points are matched by index if both clouds have equally many points, and if in each pair of
    equal index the points lie within `reach` and about as near to each other as to any other
    decoded point. Otherwise they are matched by position. First, each original point is assigned to
    the nearest decoded position. Then, the k decoded points at a position are matched to the k
    nearest of the original points assigned to it. Decoded points that are left over are matched to
    the nearest original point within `reach`.

    Parameters
    ----------
    original, decoded
        Points (n, 3) and (m, 3) in the same coordinate frame, at least one of each.
    reach
        Largest distance of a decoded point from its original point. By default, it is the largest
        distance of an original point from the nearest decoded point.

    Returns
    -------
    Match
        Index of the original point for each decoded point, and how the points were matched.
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
    """Return the largest distance of `points` (n, 3) from the nearest of `decoded` (m, 3)."""
    return float(_distances(points, decoded).max())


def share_beyond(points: Floats, others: Floats, distance: float) -> float:
    """Return the share of `points` (n, 3) that are farther than `distance` from all `others`.

    The share is from 0 to 1; `others` has the shape (m, 3).
    """
    return float(np.mean(_distances(points, others) > distance))


def _distances(points: Floats, others: Floats) -> Floats:
    from pykdtree.kdtree import KDTree

    corner = others.min(axis=0)
    distances: Floats = KDTree(others - corner).query(points - corner)[0]
    return distances

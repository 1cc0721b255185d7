from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

_SLACK = 1 + 1e-6


class Match(NamedTuple):
    """Original points of decoded points.

    Parameters
    ----------
    rows
        (m,) index of the original point of each decoded one; -1: none within `reach`.
    by
        Whether points were matched by their order or by their positions.
    unused
        Number of original points that no decoded point matches.
    reach
        Largest distance of a decoded point from its original.
    """

    rows: NDArray[np.int64]
    by: Literal["order", "position"]
    unused: int
    reach: float

    @property
    def unmatched(self) -> int:
        """Number of decoded points without an original one."""
        return int(np.count_nonzero(self.rows < 0))


def match_points(original: Floats, decoded: Floats, reach: float | None = None) -> Match:
    """Find the original point of each decoded point, to give it the original's attributes.

    Equally many decoded and original points, each within `reach` of that with the same index, have
    the same order. Otherwise an original point belongs to the nearest decoded position. A position
    with several gets the nearest, or as many as there are decoded points at the position; one
    without any gets the original point nearest to it.

    Parameters
    ----------
    original, decoded
        Points (n, 3) and (m, 3), at least one of each.
    reach
        Largest distance of a decoded point from its original; by default the largest distance of an
        original point from its nearest decoded one.
    """
    from pykdtree.kdtree import KDTree

    corner = original.min(axis=0)
    original, decoded = original - corner, decoded - corner
    places, place, copies = np.unique(decoded, axis=0, return_inverse=True, return_counts=True)
    distances, nearest = KDTree(places).query(original)
    reach = float(distances.max() if reach is None else reach) * _SLACK
    if len(original) == len(decoded):
        errors = np.linalg.norm(decoded - original, axis=1)
        if errors.max() <= reach:
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

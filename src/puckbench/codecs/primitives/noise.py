"""How noisy a cloud is: the spread of its points about the planes of small cells."""

from __future__ import annotations

import numpy as np

from puckbench.codecs.primitives.tree import cell_starts, moments_of, plane_costs
from puckbench.geometry.cloud import Floats

_FEWEST = 8


def spread(points: Floats, cell: float) -> float:
    """Standard deviation that three of four points exceed within cubic cells of side `cell`.

    Curved and crossing surfaces widen some cells, noise widens all. Zero if all cells are sparse.
    """
    order, starts = cell_starts(points, cell)
    kept = points[order] - points.mean(axis=0)
    moments = np.add.reduceat(moments_of(kept), starts, axis=0)
    counts = moments[:, 0]
    enough = counts >= _FEWEST
    if not enough.any():
        return 0.0
    variance = plane_costs(moments[enough]) / (counts[enough] - 3)
    by_size = np.argsort(variance, kind="stable")
    below = np.cumsum(counts[enough][by_size])
    quarter = np.searchsorted(below, below[-1] / 4)
    return float(np.sqrt(variance[by_size[quarter]]))

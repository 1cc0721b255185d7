"""Noise estimation: the spread of a cloud's points about the planes of small cells."""

from __future__ import annotations

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.primitives.cells import group_by_cell
from puckbench.primitives.octree import moments_of, plane_errors

_MIN_POINTS = 8


def estimate_noise(points: Floats, cell: float) -> float:
    """Standard deviation of the noise: the lower quartile over small cells, weighted by points.

    Curved and crossing surfaces widen the spread of some cells, noise that of all.

    Parameters
    ----------
    points
        (n, 3) points.
    cell
        Side of the cubic cells, in the points' unit.

    Returns
    -------
    float
        The standard deviation in the points' unit; 0 if no cell has enough points.
    """
    order, starts = group_by_cell(points, cell).order()
    centred = points[order] - points.mean(axis=0)
    moments = np.add.reduceat(moments_of(centred), starts, axis=0)
    moments = moments[moments[:, 0] >= _MIN_POINTS]
    if not len(moments):
        return 0.0
    counts = moments[:, 0]
    variance = plane_errors(moments) / (counts - 3)
    ascending = np.argsort(variance, kind="stable")
    points_below = np.cumsum(counts[ascending])
    quartile = np.searchsorted(points_below, points_below[-1] / 4)
    return float(np.sqrt(variance[ascending[quartile]]))

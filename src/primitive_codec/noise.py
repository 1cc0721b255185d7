from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats
from primitive_codec.cells import group_by_cell
from primitive_codec.octree import moments_of, plane_errors

_MIN_POINTS = 8


def estimate_noise(points: Floats, cell_size: float) -> float:
    """Estimate the standard deviation of the noise; 0 if no cell has enough points.

    The estimate is the lower quartile, weighted by points, of the cells' deviations from fitted
    planes; curved and crossing surfaces raise only higher quantiles.
    """
    rows, starts = group_by_cell(points, cell_size).sorted_rows()
    centred = points[rows] - points.mean(axis=0)
    moments = np.add.reduceat(moments_of(centred), starts, axis=0)
    moments = moments[moments[:, 0] >= _MIN_POINTS]
    if not len(moments):
        return 0.0
    counts = moments[:, 0]
    variance = plane_errors(moments) / (counts - 3)
    ascending = np.argsort(variance, kind="stable")
    cumulative_counts = np.cumsum(counts[ascending])
    quartile = np.searchsorted(cumulative_counts, cumulative_counts[-1] / 4)
    return float(np.sqrt(variance[ascending[quartile]]))

"""Differences of values between nearest neighbours of two clouds, as in MPEG's pc_error.

Values of points with equal coordinates, and of equidistant neighbours, are averaged.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats, check_points
from puckbench.geometry.neighbours import Neighbours, SearchablePoints


class DistinctValues(NamedTuple):
    """The distinct points (m, 3) of a cloud, and the mean values (m, components) at each point."""

    points: Floats
    values: Floats


def distinct_values(points: Floats, values: Floats, source: str) -> DistinctValues:
    """Merge points with equal coordinates, and average their values.

    Parameters
    ----------
    points
        Points (n, 3).
    values
        Values of the points (n, components), such as colours.
    source
        Name of the cloud with which the message of an InputError begins.
    """
    check_points(points, source)
    merged, inverse, counts = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse.ravel(), column) for column in values.T]
    return DistinctValues(merged, np.stack(sums, axis=1) / counts[:, None])


def pair_errors(a: DistinctValues, b: DistinctValues) -> tuple[Floats, Floats]:
    """Compare the values of two clouds between nearest neighbours, in both directions.

    Returns
    -------
    tuple
        The mean squared differences (components,) and the largest absolute differences
        (components,). Each is the larger one of both directions.
    """
    a_points, b_points = SearchablePoints(a.points), SearchablePoints(b.points)
    ab = np.abs(a.values - _means(b.values, b_points.nearest(a_points)))
    ba = np.abs(b.values - _means(a.values, a_points.nearest(b_points)))
    squared = np.maximum(np.mean(ab**2, axis=0), np.mean(ba**2, axis=0))
    return squared, np.maximum(ab.max(axis=0), ba.max(axis=0))


def same_values(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Return whether two arrays contain the same rows, each equally often, in any order."""
    if a.shape != b.shape:
        return False
    first, second = (each.reshape(len(each), -1) for each in (a, b))
    return np.array_equal(first[np.lexsort(first.T)], second[np.lexsort(second.T)])


def _means(values: Floats, nearest: Neighbours) -> Floats:
    sums = np.add.reduceat(values[nearest.index], nearest.starts[:-1], axis=0)
    return np.asarray(sums / np.diff(nearest.starts)[:, None])

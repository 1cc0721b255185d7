from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats, check_points
from pointkit.geometry.spatial_order import distinct_points
from pointkit.seeding import generator

NEIGHBOURS = 16
QUERIES = 100_000
"""Maximum number of query points, sampled at random."""
OUTLIER_DEVIATIONS = 2.0


def density(points: Floats) -> dict[str, float]:
    """Measure the spacing, density and outliers of a cloud from distances to nearest neighbours.

    Duplicate points are removed first. Of the others, at most 100,000 random ones are measured,
    each by its k = 16 nearest neighbours.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1.

    Returns
    -------
    dict
        * ``duplicates``: fraction of points that repeat an earlier position.
        * ``spacing_median``, ``spacing_q05``, ``spacing_q95``: median, 5 % and 95 % quantile of the
          distance to the nearest neighbour, in units of the cloud.
        * ``density_median``, ``density_q05``, ``density_q95``: the same of k / (pi r^2), where r is
          the distance to the k-th neighbour; in points per squared unit.
        * ``outliers``: fraction of points whose mean distance to k neighbours exceeds the average
          by two standard deviations (Rusu et al. 2008).

        If all points are equal, there is only ``duplicates``.
    """
    check_points(points, "density")
    points = np.ascontiguousarray(points, dtype=np.float64)
    _, distinct = distinct_points(points)
    values = {"duplicates": 1 - len(distinct) / len(points)}
    if len(distinct) == 1:
        return values
    distances = _neighbour_distances(distinct)
    k = distances.shape[1]
    values |= _shares("spacing", distances[:, 0])
    values |= _shares("density", k / (np.pi * distances[:, -1] ** 2))
    means = distances.mean(axis=1)
    limit = means.mean() + OUTLIER_DEVIATIONS * means.std()
    return values | {"outliers": float(np.mean(means > limit))}


def _neighbour_distances(points: Floats) -> Floats:
    from pykdtree.kdtree import KDTree

    rows = np.arange(len(points))
    if len(points) > QUERIES:
        rows = np.sort(generator(0, "density").choice(len(points), QUERIES, replace=False))
    k = min(NEIGHBOURS, len(points) - 1)
    distances, _ = KDTree(points).query(points[rows], k=k + 1)
    return np.asarray(distances[:, 1:])


def _shares(name: str, values: Floats) -> dict[str, float]:
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {
        f"{name}_median": float(middle),
        f"{name}_q05": float(low),
        f"{name}_q95": float(high),
    }


def density_in_metres(values: dict[str, float], scale: float) -> dict[str, float]:
    """Convert the results of `density` from units of the cloud to metres.

    Parameters
    ----------
    values
        Result of `density`.
    scale
        Units of the cloud per metre.

    Returns
    -------
    dict
        The converted values. Names of spacings get the suffix ``_m``, names of densities ``_m2``.
    """
    converted = {}
    for name, value in values.items():
        if name.startswith("spacing"):
            converted[f"{name}_m"] = value / scale
        elif name.startswith("density"):
            converted[f"{name}_m2"] = value * scale**2
        else:
            converted[name] = value
    return converted

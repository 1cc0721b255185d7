"""How densely a cloud's points lie, how evenly, and how many stand apart from the others."""

from __future__ import annotations

import numpy as np

from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats, check_points
from puckbench.geometry.spatial_order import distinct_points

NEIGHBOURS = 16
QUERIES = 100_000
"""Number of points of a larger cloud that are drawn at random as queries, among all its points."""
OUTLIER_DEVIATIONS = 2.0


def density(points: Floats) -> dict[str, float]:
    """Spacing, density and outliers of a cloud.

    Of more than 100,000 distinct points 100,000 are measured, always the same ones.

    Parameters
    ----------
    points
        (n, 3), in any unit.

    Returns
    -------
    dict
        In the unit of the points; of a single distinct point ``duplicates`` alone:

        * ``duplicates``: share of the points that have the coordinates of an earlier one; the
          others are of the distinct points.
        * ``spacing_median``, ``spacing_q05``, ``spacing_q95``: distance to the nearest other point.
        * ``density_median``, ``density_q05``, ``density_q95``: points per unit of area,
          k / (pi r^2) with the distance r of the k-th nearest of 16, as if the surface were flat.
        * ``outliers``: share of the points whose mean distance to these neighbours is beyond the
          mean over points by more than two standard deviations (Rusu et al. 2008, the statistical
          outlier removal of PCL and Open3D). Uneven sampling counts as well as noise.

    Raises
    ------
    InputError
        There are no points, or some are not finite.
    """
    check_points(points, "density")
    points = np.ascontiguousarray(points, dtype=np.float64)
    _, distinct = distinct_points(points)
    found = {"duplicates": 1 - len(distinct) / len(points)}
    if len(distinct) == 1:
        return found
    distances = _neighbour_distances(distinct)
    k = distances.shape[1]
    found |= _shares("spacing", distances[:, 0])
    found |= _shares("density", k / (np.pi * distances[:, -1] ** 2))
    means = distances.mean(axis=1)
    limit = means.mean() + OUTLIER_DEVIATIONS * means.std()
    return found | {"outliers": float(np.mean(means > limit))}


def _neighbour_distances(points: Floats) -> Floats:
    """Distances (m, k) of the nearest others of up to `QUERIES` of the points, nearest first."""
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


def in_metres(values: dict[str, float], scale: float) -> dict[str, float]:
    """Values of `density` as ``spacing_..._m`` and ``density_..._m2`` (per square metre).

    `scale` is in units per metre; shares keep their names.
    """
    found = {}
    for name, value in values.items():
        if name.startswith("spacing"):
            found[f"{name}_m"] = value / scale
        elif name.startswith("density"):
            found[f"{name}_m2"] = value * scale**2
        else:
            found[name] = value
    return found

"""The registry of optional metrics, which a configuration names under `metrics`.

A metric is a function with its registration above it::

    @METRICS.register("centroid")
    def centroid(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
        \"\"\"Return the distance between the centroids.\"\"\"
        offset = reference.xyz.mean(axis=0) - decoded.xyz.mean(axis=0)
        return {"centroid_m": float(np.linalg.norm(offset)) / reference.about["scale"]}

Each key becomes a column of the results, so it should end in its unit. Both clouds are in one
coordinate frame, with ``reference.about["scale"]`` units per metre.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

from puckbench.core.errors import InputError
from puckbench.core.registry import Registry
from puckbench.geometry.cloud import PointCloud

Metric = Callable[[PointCloud, PointCloud], Mapping[str, float]]

METRICS: Registry[Metric] = Registry("metric", "further_metrics")


def further_metrics(
    names: Iterable[str], reference: PointCloud, decoded: PointCloud, columns: Collection[str]
) -> dict[str, float]:
    """Return the values of optional metrics of a decoded cloud.

    A name is that of a registered metric, or ``path/to/file.py:function``. Raises InputError if a
    metric returns a name in `columns`.
    """
    results: dict[str, float] = {}
    for name in names:
        values = METRICS.get(name)(reference, decoded)
        if clash := sorted(values.keys() & {*columns, *results}):
            raise InputError(f"metric {name}: the column '{clash[0]}' exists already; rename it")
        results |= values
    return results

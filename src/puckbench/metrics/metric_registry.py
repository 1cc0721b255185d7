"""The registry of optional metrics, which a configuration names under `metrics`.

A metric is a registered function::

    @METRICS.register("centroid", columns={"centroid_m": "Distance between the centroids"})
    def centroid(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
        \"\"\"Return the distance between the centroids.\"\"\"
        offset = reference.xyz.mean(axis=0) - decoded.xyz.mean(axis=0)
        return {"centroid_m": float(np.linalg.norm(offset)) / reference.about["scale"]}

Each key becomes a column of the results and should end in the unit; `columns` declares them, with
their meanings or as `Column` objects. Both clouds are in one coordinate frame, with
``reference.about["scale"]`` units per metre.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import Registry
from puckbench.results.columns import Columns, declare, declared_by

Metric = Callable[[PointCloud, PointCloud], Mapping[str, float]]


def _registered(_: str, metric: Metric, columns: Columns = ()) -> Metric:
    declare(columns)
    return metric


METRICS: Registry[Metric] = Registry("metric", "further_metrics", make=_registered)
declared_by(METRICS.names)


def further_metrics(
    names: Iterable[str], reference: PointCloud, decoded: PointCloud, columns: Collection[str]
) -> dict[str, float]:
    """Compute optional metrics of a decoded cloud.

    Parameters
    ----------
    names
        Names of registered metrics, or ``path/to/file.py:function``.
    reference, decoded
        The original and the decoded cloud, in one coordinate frame.
    columns
        Names of results that exist already.

    Returns
    -------
    dict
        The values of all metrics by name of their column.

    Raises
    ------
    InputError
        A metric is unknown, or the name of a value is in `columns` or occurs twice.
    """
    results: dict[str, float] = {}
    for name in names:
        values = METRICS.get(name)(reference, decoded)
        if clash := sorted(values.keys() & {*columns, *results}):
            raise InputError(f"metric {name}: the column '{clash[0]}' exists already; rename it")
        results |= values
    return results

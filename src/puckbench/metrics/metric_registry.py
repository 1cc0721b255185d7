"""The registry of optional metrics, which a configuration names under `metrics`.

A metric is a registered function of two clouds, the reference and the decoded one; CONTRIBUTING.md
has an example. Each key of its result becomes a column of the results and should end in its unit;
`columns` explains them. Both clouds are in one coordinate frame, with ``reference.about["scale"]``
units per metre.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from types import MappingProxyType

from puckbench.core.errors import InputError
from puckbench.core.registry import Registry
from puckbench.geometry.cloud import PointCloud

Metric = Callable[[PointCloud, PointCloud], Mapping[str, float]]

_meanings: dict[str, str] = {}


def _registered(
    _: str, metric: Metric, columns: Mapping[str, str] = MappingProxyType({})
) -> Metric:
    _meanings.update(columns)
    return metric


METRICS: Registry[Metric] = Registry("metric", "further_metrics", make=_registered)


def metric_columns() -> dict[str, str]:
    """Return the meanings of the columns of optional metrics."""
    METRICS.names()
    return dict(_meanings)


def further_metrics(
    names: Iterable[str], reference: PointCloud, decoded: PointCloud, columns: Collection[str]
) -> dict[str, float]:
    """Return the values of optional metrics of a decoded cloud.

    A name is a registered metric's, or ``path/to/file.py:function``. Raises InputError if the name
    of a result is in `columns`.
    """
    results: dict[str, float] = {}
    for name in names:
        values = METRICS.get(name)(reference, decoded)
        if clash := sorted(values.keys() & {*columns, *results}):
            raise InputError(f"metric {name}: the column '{clash[0]}' exists already; rename it")
        results |= values
    return results

"""Further metrics of decoded clouds, which a configuration names under `metrics`.

A metric is one function with its registration above it::

    @METRICS.register("centroid")
    def centroid(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
        \"\"\"How far the mean of all points has moved.\"\"\"

Each number that it returns is a column of the table of results, which it should say the unit of:
clouds are in the reference's frame, ``reference.about["scale"]`` is its units per metre.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

from puckbench.core.errors import InputError
from puckbench.core.registry import Registry
from puckbench.geometry.cloud import PointCloud

Metric = Callable[[PointCloud, PointCloud], Mapping[str, float]]

METRICS: Registry[Metric] = Registry("metric", "further_metrics")


def further_metrics(
    names: Iterable[str], reference: PointCloud, decoded: PointCloud, taken: Collection[str]
) -> dict[str, float]:
    """The numbers of further metrics.

    Parameters
    ----------
    names
        Of registered metrics, or ``path/to/file.py:function``.
    reference, decoded
        The cloud that was coded, and what became of it.
    taken
        Columns that the result row has already.

    Raises
    ------
    InputError
        A metric is unknown, or gives a column that is taken.
    """
    found: dict[str, float] = {}
    for name in names:
        values = METRICS.get(name)(reference, decoded)
        if clash := sorted(values.keys() & {*taken, *found}):
            raise InputError(f"metric {name}: the column '{clash[0]}' is taken")
        found |= values
    return found

"""The registry of optional metrics, which a configuration names under `metrics`.

A metric is a registered function::

    @METRICS.register("centroid", columns={"centroid_m": "Distance between the centroids"})
    def centroid(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
        \"\"\"Return the distance between the centroids.\"\"\"
        offset = reference.xyz.mean(axis=0) - decoded.xyz.mean(axis=0)
        return {"centroid_m": float(np.linalg.norm(offset)) / reference.about["scale"]}

Each key becomes a column of the results and should end in the unit; `columns` declares them, with
their meanings or as `Column` objects. Both clouds are in one coordinate frame, with
``reference.about["scale"]`` units per metre. Further parameters are options, which the entry of a
data set sets under `metrics`.

If much work depends on the original cloud alone, the metric is a class: it is created once for
each original, and called with every cloud that was decoded from it::

    @METRICS.register("seen")
    class Seen:
        def __init__(self, reference: PointCloud, *, width: int = 64) -> None: ...
        def __call__(self, decoded: PointCloud) -> dict[str, float]: ...

A metric that is a task of a robot tells by which column it is judged: ``measures=``
(`puckbench.metrics.task_measures`). With ``needs=("package",)``, runs without the package omit the
metric. With ``files=function``, a function of the options that returns paths, the metric is
measured again if one of these files changes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any, ClassVar

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import Registry
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.results.columns import Columns, declare, declared_by

Options = Mapping[str, Any]
Measure = Callable[..., Any]
"""A function of the original cloud, a decoded cloud and options, or a class (see above)."""
Measured = Callable[[PointCloud], Mapping[str, Any]]
"""A metric of one original cloud, as a function of a cloud that was decoded from it."""


def _no_files(**_: Any) -> Iterable[Path]:
    return ()


@dataclass(frozen=True)
class Measurer:
    """Base class of registered metrics, which judge decoded clouds, and tasks, which judge drives.

    Parameters
    ----------
    name
        Name under which it is registered.
    measure
        The function or class that measures.
    measures
        By what it is judged after coding, if it is a task of a robot.
    needs
        Names of Python modules that it requires.
    """

    kind: ClassVar[str]
    """What it is called in messages."""

    name: str
    measure: Measure
    measures: tuple[TaskMeasure, ...] = ()
    needs: tuple[str, ...] = ()

    @property
    def missing(self) -> tuple[str, ...]:
        """The names of required modules that are not installed."""
        return tuple(name for name in self.needs if find_spec(name) is None)

    def check(self, options: Options) -> None:
        """Raise InputError if an option is missing or unknown."""
        given = (None,) if isinstance(self.measure, type) else (None, None)
        try:
            signature(self.measure).bind(*given, **options)
        except TypeError as error:
            raise InputError(f"{self.kind} {self.name}: options: {error}") from error

    def add(
        self, results: dict[str, Any], values: Mapping[str, Any], columns: Collection[str]
    ) -> None:
        """Add values, by name of their column, to results.

        Raises InputError if the name of a value is in `results` or `columns`.
        """
        if clash := sorted(values.keys() & {*columns, *results}):
            fault = f"the column '{clash[0]}' exists already; rename it"
            raise InputError(f"{self.kind} {self.name}: {fault}")
        results |= values


@dataclass(frozen=True)
class Metric(Measurer):
    """A registered metric of single clouds.

    Parameters
    ----------
    files
        Function that returns the paths of the files that options name.
    memory_mb
        Memory, in MB, that the metric needs besides that of the codec.
    """

    kind = "metric"

    files: Callable[..., Iterable[Path]] = _no_files
    memory_mb: int = 0

    def of(self, reference: PointCloud, options: Options) -> Measured:
        """Return the metric of clouds that were decoded from an original cloud.

        Parameters
        ----------
        reference
            The original cloud.
        options
            Values of the metric's options by name.

        Raises
        ------
        InputError
            An option is missing or unknown, or the metric cannot measure this cloud.
        """
        self.check(options)
        if isinstance(self.measure, type):
            opened: Measured = self.measure(reference, **options)
            return opened
        return partial(self.measure, reference, **options)


def _registered(
    name: str,
    measure: Measure,
    columns: Columns = (),
    measures: Iterable[TaskMeasure] = (),
    **more: Any,
) -> Metric:
    declare(columns)
    return Metric(name, measure, tuple(measures), **more)


METRICS: Registry[Metric] = Registry("metric", "further_metrics", make=_registered)
declared_by(METRICS.names)


class FurtherMetrics:
    """Optional metrics of the clouds that are decoded from one original.

    Parameters
    ----------
    metrics
        Options of each metric, by name of the metric or place (``path/to/file.py:function``).
    reference
        The original cloud.

    Raises
    ------
    InputError
        A metric or option is unknown, or a metric cannot measure the original.
    """

    def __init__(self, metrics: Mapping[str, Options], reference: PointCloud) -> None:
        chosen = [(METRICS.get(name), options) for name, options in metrics.items()]
        self._metrics = [(metric, metric.of(reference, options)) for metric, options in chosen]

    def of(self, decoded: PointCloud, columns: Collection[str]) -> dict[str, Any]:
        """Return the values of all metrics of a decoded cloud, by name of their column.

        Parameters
        ----------
        decoded
            The decoded cloud, in the coordinate frame of the original.
        columns
            Names of results that exist already.

        Raises
        ------
        InputError
            The name of a value is in `columns` or occurs twice.
        """
        results: dict[str, Any] = {}
        for metric, measured in self._metrics:
            metric.add(results, measured(decoded), columns)
        return results


def further_metrics(
    metrics: Mapping[str, Options] | Iterable[str],
    reference: PointCloud,
    decoded: PointCloud,
    columns: Collection[str],
) -> dict[str, Any]:
    """Compute optional metrics of one decoded cloud.

    Parameters
    ----------
    metrics
        Names of registered metrics, or ``path/to/file.py:function``; or options by these names.
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
        A metric or option is unknown, or the name of a value is in `columns` or occurs twice.
    """
    return FurtherMetrics(with_options(metrics), reference).of(decoded, columns)


def with_options(metrics: Mapping[str, Options] | Iterable[str]) -> dict[str, Options]:
    """Return the options of metrics by name; metrics that are only named have none."""
    if isinstance(metrics, Mapping):
        return dict(metrics)
    return {name: {} for name in metrics}

"""The registry of tasks, which measure decoded drives; a drive's configuration lists `tasks`.

A task is a registered function::

    @TASKS.register("nearest")
    def nearest(drive: Drive, decoded: Sequence[PointCloud]) -> dict[str, float]:
        \"\"\"Return the smallest distance of a point.\"\"\"

Each key becomes a column of the results and should end in the unit; ``columns=`` declares them as
that of a metric does (`puckbench.metrics.metric_registry`). Decoded turns have ``returns``
if the codec keeps the order and times of firings. A value of type bytes is no column, but the
content of a file with the key as its name, such as ``way.tum``. Further parameters are options.
With ``needs=("package",)``, runs without the package omit the task. ``measures=`` tells by which
columns the task is judged (`puckbench.metrics.task_measures`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from inspect import signature
from typing import Any

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import Registry
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.recordings.drives import Drive
from puckbench.results.columns import TASK, Columns, declare, declared_by

Measure = Callable[..., Mapping[str, Any]]


@dataclass(frozen=True)
class Task:
    """A registered task: a function that measures how useful decoded turns of a drive are.

    Parameters
    ----------
    name
        Name under which the task is registered.
    measure
        Function that returns results by column name, and contents of files by file name, from a
        drive, its decoded turns, and options.
    needs
        Names of Python modules that the task requires.
    measures
        By what the task is judged after coding.
    """

    name: str
    measure: Measure
    needs: tuple[str, ...] = ()
    measures: tuple[TaskMeasure, ...] = ()

    @property
    def missing(self) -> tuple[str, ...]:
        """The names of required modules that are not installed."""
        return tuple(name for name in self.needs if find_spec(name) is None)


def _registered(
    name: str,
    measure: Measure,
    columns: Columns = (),
    measures: Iterable[TaskMeasure] = (),
    **more: Any,
) -> Task:
    declare(columns, TASK)
    return Task(name, measure, measures=tuple(measures), **more)


TASKS: Registry[Task] = Registry("task", "tasks", make=_registered)
declared_by(TASKS.names)


def task_results(
    tasks: Mapping[str, Mapping[str, Any]],
    drive: Drive,
    decoded: Sequence[PointCloud],
    columns: Collection[str],
) -> dict[str, Any]:
    """Run tasks on a decoded drive, and return their results.

    Parameters
    ----------
    tasks
        Options of each task, by name of the task.
    drive
        The drive: a sequence of turns (revolutions of the sensor) with true poses.
    decoded
        The decoded cloud of each turn.
    columns
        Names of results that exist already.

    Returns
    -------
    dict
        The results of all tasks by name of their column, and contents of files by file name.

    Raises
    ------
    InputError
        A task or option is unknown, or the name of a result is in `columns` or occurs twice.
    """
    results: dict[str, Any] = {}
    for name, options in tasks.items():
        values = checked_task(name, options).measure(drive, decoded, **options)
        if clash := sorted(values.keys() & {*columns, *results}):
            raise InputError(f"task {name}: the column '{clash[0]}' exists already; rename it")
        results |= values
    return results


def checked_task(name: str, options: Mapping[str, Any]) -> Task:
    """Return a registered task after a check of its options.

    Raises InputError if the task is unknown, or an option is missing or unknown.
    """
    task = TASKS.get(name)
    try:
        signature(task.measure).bind(None, (), **options)
    except TypeError as error:
        raise InputError(f"task {name}: options: {error}") from error
    return task

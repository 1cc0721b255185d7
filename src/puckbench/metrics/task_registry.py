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
from typing import Any

from pointkit.geometry.cloud import PointCloud
from pointkit.registry import Registry
from puckbench.metrics.metric_registry import Measurer
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.recordings.drives import Drive
from puckbench.results.columns import TASK, Columns, declare, declared_by

Measure = Callable[..., Mapping[str, Any]]


class Task(Measurer):
    """A registered task: its `measure` is a function of a drive, its decoded turns, and options.

    It returns results by column name, and contents of files by file name.
    """

    kind = "task"


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
        task = checked_task(name, options)
        task.add(results, task.measure(drive, decoded, **options), columns)
    return results


def checked_task(name: str, options: Mapping[str, Any]) -> Task:
    """Return a registered task after a check of its options.

    Raises InputError if the task is unknown, or an option is missing or unknown.
    """
    task = TASKS.get(name)
    task.check(options)
    return task

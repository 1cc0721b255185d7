from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError
from puckbench.codecs.registry import codec_class, is_codec
from puckbench.metrics.metric_registry import METRICS
from puckbench.metrics.statistics import (
    NO_VERDICT,
    SCENE,
    UNDECIDED,
    Estimate,
    means_over_seeds,
)
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.metrics.task_registry import TASKS
from puckbench.recordings.drives import AZIMUTH, KEPT, NONE
from puckbench.tables.registry import PERCEPTION, TABLES, UNDECODED

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.metrics.task_measures", "puckbench.recordings.drives")

KEYS = ("dataset", "task", "codec", "rate")
_DIGITS = 6
"""Decimals of losses: smaller ones are those of sums in another order."""
_BEST_TIMES = (KEPT, AZIMUTH, NONE)
"""Kinds of times of the points of a decoded drive; the first that there is counts."""


@TABLES.register(
    "perception_losses",
    title="Tasks after coding, against before",
    needs=(PERCEPTION,),
    columns={
        "task": "Task",
        "task_title": "Task, in words",
        "loss": "Loss to no coding",
        "along_rays": "Points move along their rays",
        "most_bits": "Bits of the highest rate",
    },
    shown=(*KEYS, "bits", "undecoded", "loss", "verdict"),
)
def perception_losses(
    metrics: pd.DataFrame | None = None,
    drives: pd.DataFrame | None = None,
    clouds: pd.DataFrame | None = None,
    measures: Sequence[Mapping[str, Any]] | None = None,
    along_rays: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The table shows how much worse each task gets by coding, on the same scans or drives.

    ``bits`` are bits per point or return, ``undecoded`` and ``value`` the mean results of the task
    without and with coding, in ``unit``. ``loss`` is the mean of the paired losses: positive if
    coding makes the task worse. Scans of one scene are averaged first. For 6 or more scenes,
    ``low`` and ``high`` are the 95 % interval of the loss by Student's t. ``least`` and ``most``
    are the extreme losses of a scene. ``margin`` is fixed before the measurement, by the task or as
    ``task_margins`` in the configuration. ``verdict`` is ``better`` if the interval is below 0,
    ``not worse`` if it is below the margin, ``worse`` if it is above 0, otherwise ``undecided``,
    and ``no verdict`` for fewer than 6 scenes. ``along_rays`` tells whether the codec codes
    returns, whose errors are along the sensor's rays, or points, which it moves to a grid.
    """
    import pandas as pd

    judged = declared_measures() if measures is None else tuple(map(_measure, measures))
    sensors = _sensors(clouds)

    def moved_along_rays(codec: str) -> bool:
        return _is_along_rays(codec) if along_rays is None else codec in along_rays

    rows = [
        {
            **row,
            "along_rays": moved_along_rays(str(row["codec"])),
            "sensor": sensors.get(str(row["dataset"]), ""),
        }
        for table in (metrics, drives)
        if table is not None
        for measure in judged
        for row in _losses(table, measure)
    ]
    if not rows:
        raise InputError("no results of a task and of the same scans without coding")
    return pd.DataFrame(rows)


def declared_measures() -> tuple[TaskMeasure, ...]:
    """Return the measures of all registered metrics and tasks, with the margins they declare."""
    of_metrics = (METRICS.get(name).measures for name in METRICS.names())
    of_tasks = (TASKS.get(name).measures for name in TASKS.names())
    return tuple(chain.from_iterable((*of_metrics, *of_tasks)))


def _is_along_rays(codec: str) -> bool:
    return is_codec(codec) and codec_class(codec).along_rays


def _measure(values: Mapping[str, Any]) -> TaskMeasure:
    return TaskMeasure.model_validate(dict(values))


def _sensors(clouds: pd.DataFrame | None) -> dict[str, str]:
    """Return the sensors of each data set, by its name, as text such as "hdl32e, vlp16".

    Data sets whose clouds name no sensor are left out.
    """
    if clouds is None or "sensor" not in clouds:
        return {}
    known = clouds[clouds["sensor"].notna()]
    groups = known.groupby("dataset", sort=False)["sensor"]
    return {str(name): ", ".join(sorted(set(map(str, each)))) for name, each in groups}


def _losses(table: pd.DataFrame, measure: TaskMeasure) -> Iterator[dict[str, Any]]:
    paired = _paired(table, measure)
    if paired is None:
        return
    loss = [measure.loss(*both) for both in zip(paired["before"], paired["after"], strict=True)]
    paired = paired.assign(loss=np.round(loss, _DIGITS))
    means = means_over_seeds(paired, KEYS[:1] + KEYS[2:], ["loss", "before", "after", "bpp"])
    for dataset, of_dataset in means.groupby("dataset", sort=False):
        scenes = of_dataset[SCENE].nunique()
        for (codec, rate), group in of_dataset.groupby(["codec", "rate"], sort=False):
            named = {"dataset": dataset, "task": measure.name, "codec": codec, "rate": rate}
            yield {**named, **_row(group, measure, scenes)}


def _row(group: pd.DataFrame, measure: TaskMeasure, scenes: int) -> dict[str, Any]:
    loss = Estimate.of(group["loss"])
    verdict = loss.verdict(measure.margin)
    if len(group) < scenes and verdict != NO_VERDICT:  # some scenes could not be coded
        verdict = UNDECIDED
    return {
        "task_title": measure.title,
        "unit": measure.unit,
        "bits": float(group["bpp"].mean()),
        "scenes": len(group),
        "undecoded": float(group["before"].mean()),
        "value": float(group["after"].mean()),
        "loss": loss.mean,
        "low": loss.low,
        "high": loss.high,
        "least": loss.least,
        "most": loss.most,
        "margin": measure.margin,
        "verdict": verdict,
    }


def _paired(table: pd.DataFrame, measure: TaskMeasure) -> pd.DataFrame | None:
    """Return the rows of coded clouds or drives, with the results ``before`` and ``after`` coding.

    None if there are no results of the task.
    """
    if measure.column not in table:
        return None
    rows = table[table[measure.column].notna()]
    if measure.undecoded:
        rows = rows[rows[measure.undecoded].notna()] if measure.undecoded in rows else rows[:0]
        before = rows[measure.undecoded].to_numpy(float)
    else:
        rows = _best_timed(rows)
        undecoded = rows[rows["codec"] == UNDECODED]
        baseline = undecoded.set_index(["dataset", "cloud"])[measure.column].astype(float)
        rows = rows[rows["codec"] != UNDECODED]
        keys = list(zip(rows["dataset"], rows["cloud"], strict=True))
        before = baseline.reindex(keys).to_numpy()
    if rows.empty:
        return None
    paired = rows.assign(before=before, after=rows[measure.column].astype(float))
    return paired[paired["before"].notna()]


def _best_timed(drives: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each drive, codec and rate: that with the best times of points."""
    if "times" not in drives:
        return drives
    ranks = {kind: rank for rank, kind in enumerate(_BEST_TIMES)}
    ordered = drives.assign(_rank=drives["times"].map(ranks)).sort_values("_rank", kind="stable")
    rate = ordered["rate"].where(ordered["codec"] != UNDECODED, "")
    first = ~ordered.assign(rate=rate).duplicated(["dataset", "cloud", "codec", "rate"])
    return ordered[first].drop(columns="_rank").sort_index()

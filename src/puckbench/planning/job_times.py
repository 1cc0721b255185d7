"""Estimates of the time of a run from the logged costs of another run.

Jobs log their processor time (`puckbench.jobs.cost`), which other work on the machine hardly
affects.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_object
from puckbench.geometry.cloud import Floats
from puckbench.jobs.cost import read_cost

_OF_CURVES = ("encode_curve", "evaluate_curve", "recovery_curve")
_OF_CLOUDS = ("sample", "scan", "prepare", "evaluate", *_OF_CURVES)
"""Jobs whose time grows with the number of points."""
_ONE_SIZE = 0.1
"""Clouds count as equally large if their numbers of points differ by at most this fraction of the
median."""
_MOST = 1000
"""Maximum number of jobs in a fit, which uses all pairs of jobs."""


@dataclass(frozen=True)
class JobTime:
    """The cost of a finished job.

    Parameters
    ----------
    rates, points
        Number of rates in its curve and of points in its cloud, or 0.
    seconds
        Processor time.
    call_s, repeats
        Seconds of one call for each rate, in total, and repetitions.
    truth
        Whether a decoded cloud was compared with the true surface.
    """

    job: str
    codec: str
    rates: int
    points: int
    seconds: float
    call_s: float = 0.0
    repeats: int = 0
    truth: bool = False
    peak_mib: int = 0

    def of(self, rates: int, repeats: int) -> float:
        share = rates / self.rates if self.rates else 1.0
        return max(0.0, self.seconds + (repeats - self.repeats) * self.call_s) * share


@dataclass(frozen=True)
class JobKind:
    """Similar jobs of a plan: their number `jobs`, and the attributes of `JobTime`."""

    job: str
    jobs: int
    points: int = 0
    codec: str = ""
    rates: int = 0
    repeats: int = 0
    truth: bool = False


@dataclass(frozen=True)
class TimeEstimate:
    """The estimated time of similar jobs.

    `seconds` is the time of one job, None if no similar job was measured; `measured` is the number
    of measured jobs; `reach` is the planned number of points divided by the largest measured
    number.
    """

    kind: JobKind
    seconds: float | None
    measured: int = 0
    reach: float = 0.0
    exact: bool = True

    @property
    def hours(self) -> float:
        return self.kind.jobs * (self.seconds or 0.0) / 3600


@dataclass(frozen=True)
class Measurements:
    points: Floats
    seconds: Floats

    @classmethod
    def of(cls, pairs: Iterable[tuple[int, float]]) -> Measurements:
        table = np.array(list(pairs), dtype=np.float64).reshape(-1, 2)
        table = table[:: 1 + len(table) // _MOST]
        return cls(table[:, 0], table[:, 1])

    def at(self, points: int) -> float:
        """Return the estimated seconds of a job for a number of points, by Theil-Sen regression.

        Its medians ignore the slow first jobs of a run, which compile. If all clouds have about the
        same size, the time is proportional to the points.
        """
        start, slope = self._line
        return start + slope * points

    @cached_property
    def _line(self) -> tuple[float, float]:
        x, y = self.points, self.seconds
        middle, typical = float(np.median(x)), float(np.median(y))
        if middle == 0:
            return typical, 0.0
        steepest = typical / middle
        first, second = np.triu_indices(len(x), 1)
        apart = np.abs(x[second] - x[first]) > _ONE_SIZE * middle
        if not apart.any():
            return 0.0, steepest
        slopes = (y[second] - y[first])[apart] / (x[second] - x[first])[apart]
        slope = min(max(float(np.median(slopes)), 0.0), steepest)
        return max(0.0, float(np.median(y - slope * x))), slope  # no job takes a negative time


def read_job_times(run: Path) -> list[JobTime]:
    """Read the costs of the jobs in the folder of a run; raise InputError if there are none."""
    logs = [log for folder in _log_folders(run) for log in sorted(folder.rglob("*.log"))]
    times = [_job_time(log, cost) for log in logs if (cost := read_cost(log))]
    if not times:
        raise InputError(f"{run}: no logs of finished jobs (results/logs)")
    return times


def _log_folders(run: Path) -> list[Path]:
    patterns = ("logs", "*/logs", "*/*/logs")
    return [folder for pattern in patterns for folder in sorted(run.glob(pattern))]


def _job_time(log: Path, cost: dict[str, Any]) -> JobTime:
    job, seconds = cost["job"], cost["processor_s"]
    peak, work = cost.get("peak_mib", 0), cost.get("work", {})
    if job not in _OF_CLOUDS:
        return JobTime(job, "", 0, 0, seconds, peak_mib=peak)
    results, _, names = str(log.with_suffix("")).rpartition("/logs/")
    _, dataset, cloud, *_ = names.split("/")
    # Assume that the timed calls have the whole job's ratio of processor time to wall time.
    share = min(1.0, seconds / cost["wall_s"]) if cost["wall_s"] else 1.0
    return JobTime(
        job,
        work.get("codec", ""),
        work.get("rates", 0),
        work.get("points") or _points(Path(results), dataset, cloud),
        seconds,
        work.get("call_s", 0.0) * share,
        work.get("repeats", 0),
        work.get("truth", False),
        peak,
    )


def _points(results: Path, dataset: str, cloud: str) -> int:
    about = results / "clouds" / dataset / f"{cloud}.json"
    points = read_object(about).get("points") if about.exists() else 0
    if not isinstance(points, int):
        raise InputError(f"{about}: points is {points!r}, but must be an integer")
    return points


def estimated(kinds: Iterable[JobKind], times: Iterable[JobTime]) -> list[TimeEstimate]:
    usable = [time for time in times if time.points or time.job not in _OF_CLOUDS]
    return [_estimate(kind, usable) for kind in kinds]


def _estimate(kind: JobKind, job_times: list[JobTime]) -> TimeEstimate:
    codecs = [time for time in job_times if (time.job, time.codec) == (kind.job, kind.codec)]
    times = [time for time in codecs if time.rates == kind.rates] or codecs
    if not times:
        return TimeEstimate(kind, None)
    alike = [time for time in times if time.truth == kind.truth] or times
    largest = max(time.points for time in alike)
    fitted = Measurements.of((time.points, time.of(kind.rates, kind.repeats)) for time in alike)
    reach = kind.points / largest if largest else 0.0
    exact = any(time.rates == kind.rates for time in times)
    return TimeEstimate(kind, fitted.at(kind.points), len(alike), reach, exact)

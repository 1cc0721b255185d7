"""How long the jobs of a finished run took, and how long those of another would take.

Snakemake keeps a record of each file that it made, with when its job began and ended: the life of
whole processes, imports included, on the machine of that run.
`benchmarks/performance/job_costs.py --out` writes their processor time instead, which other work on
the machine does not lengthen.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.files import read_json
from puckbench.geometry.cloud import Floats

_OF_CELLS = ("encode", "evaluate", "decode")
_OF_CLOUDS = ("sample", "scan", "prepare", "scan_error", *_OF_CELLS)
"""Rules whose work grows with the points of a cloud."""
_ONE_SIZE = 0.1
"""Clouds whose numbers of points differ by less, of their median, count as of one size."""
_MOST = 1000
"""Jobs that a line goes through: as many pairs as that squared, halved."""


@dataclass(frozen=True)
class JobTime:
    """One finished job. codec, rate: empty where it has none. points: of its cloud, 0 if none.

    call_s, repeats: of the timed call within it, and how often it was made. truth: whether a
    decoded cloud was measured against the true surface as well.
    """

    rule: str
    codec: str
    rate: str
    points: int
    seconds: float
    call_s: float = 0.0
    repeats: int = 0
    truth: bool = False

    def with_repeats(self, repeats: int) -> float:
        """Seconds that it would have taken with so many timed calls."""
        return max(0.0, self.seconds + (repeats - self.repeats) * self.call_s)


@dataclass(frozen=True)
class JobKind:
    """Jobs of a plan that are alike: so many, with about so many points each; see JobTime."""

    rule: str
    jobs: int
    points: int = 0
    codec: str = ""
    rate: str = ""
    repeats: int = 0
    truth: bool = False


@dataclass(frozen=True)
class Estimate:
    """What jobs of a kind would take. seconds: of one, or None where none like it was measured.

    measured: jobs that it rests on. reach: points of the planned job over those of the largest
    measured one; above 1 is an extrapolation. exact: whether the rate itself was measured.
    """

    kind: JobKind
    seconds: float | None
    measured: int = 0
    reach: float = 0.0
    exact: bool = True

    @property
    def hours(self) -> float:
        """Core-hours of all jobs of the kind; 0 where nothing is known."""
        return self.kind.jobs * (self.seconds or 0.0) / 3600


@dataclass(frozen=True)
class Measurements:
    """Times of alike jobs over the points of their clouds."""

    points: Floats
    seconds: Floats

    @classmethod
    def of(cls, pairs: Iterable[tuple[int, float]]) -> Measurements:
        """Those of some (points, seconds)."""
        table = np.array(list(pairs), dtype=np.float64).reshape(-1, 2)
        table = table[:: 1 + len(table) // _MOST]
        return cls(table[:, 0], table[:, 1])

    def at(self, points: int) -> float:
        """Seconds of a job with so many points: a start and a time for each point.

        The line of Theil and Sen, of medians: the first jobs of a run, which compile, do not tilt
        it. With clouds of about one size alone, a larger one takes longer in proportion.
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
        return max(0.0, float(np.median(y - slope * x))), slope  # nor is the start below 0


def read_job_times(run: Path) -> list[JobTime]:
    """The jobs of the runs made in a folder, or those of a file that `job_costs.py` wrote.

    InputError when Snakemake kept no records in the folder.
    """
    if run.is_file():
        return [JobTime(**job) for job in read_json(run)["jobs"]]
    folder = run / ".snakemake" / "metadata"
    records = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            record = json.loads(path.read_text(encoding="utf-8"))
            if record.get("rule") and record.get("log") and record.get("endtime"):
                records[record["rule"], record["log"][0]] = record
    if not records:
        raise InputError(f"{run}: no records of finished jobs there (.snakemake/metadata)")
    return [_job_time(run, record) for record in records.values()]


def _job_time(run: Path, record: Mapping[str, Any]) -> JobTime:
    rule, log = record["rule"], Path(record["log"][0])
    return job_time(run, rule, log, float(record["endtime"]) - float(record["starttime"]))


def job_time(run: Path, rule: str, log: Path, seconds: float) -> JobTime:
    """One job of a run, told by its rule and its log; what else is known lies in its results."""
    if rule not in _OF_CLOUDS:
        return JobTime(rule, "", "", 0, seconds)
    results, _, names = str(log.with_suffix("")).partition("/logs/")
    cell = names.partition("/")[2]
    dataset, cloud, *coded = cell.split("/")
    codec, rate = coded if rule in _OF_CELLS else ("", "")
    points = _points(run / results, dataset, cloud)
    call_s, repeats, truth = _timed(run / results, rule, cell)
    return JobTime(rule, codec, rate, points, seconds, call_s, repeats, truth)


def _points(results: Path, dataset: str, cloud: str) -> int:
    about = results / "clouds" / dataset / f"{cloud}.json"
    return int(read_json(about)["points"]) if about.exists() else 0


def _timed(results: Path, rule: str, cell: str) -> tuple[float, int, bool]:
    """Seconds of a job's timed call, how often it was made, and whether truth was measured."""
    kept = {
        "encode": ("encode_s", f"coded/{cell}.bin.json"),
        "evaluate": ("decode_s", f"metrics/{cell}.json"),
    }
    column, file = kept.get(rule, ("", ""))
    if not file or not (results / file).exists():
        return 0.0, 0, False
    row = read_json(results / file)
    truth = any(name.startswith("truth_") for name in row)
    return float(row.get(column, 0.0)), int(row.get("repeats", 0)), truth


def estimated(kinds: Iterable[JobKind], times: Iterable[JobTime]) -> list[Estimate]:
    """What every kind of job would take, from the times of a run."""
    known = [time for time in times if time.points or time.rule not in _OF_CLOUDS]
    return [_estimate(kind, known) for kind in kinds]


def _estimate(kind: JobKind, known: list[JobTime]) -> Estimate:
    """From jobs of its codec and rate, else of its codec; from those with truth or without it
    as the kind's are, where there are any.
    """
    codecs = [time for time in known if (time.rule, time.codec) == (kind.rule, kind.codec)]
    times = [time for time in codecs if time.rate == kind.rate] or codecs
    if not times:
        return Estimate(kind, None)
    alike = [time for time in times if time.truth == kind.truth] or times
    largest = max(time.points for time in alike)
    found = Measurements.of((time.points, time.with_repeats(kind.repeats)) for time in alike)
    reach = kind.points / largest if largest else 0.0
    exact = any(time.rate == kind.rate for time in times)
    return Estimate(kind, found.at(kind.points), len(alike), reach, exact)

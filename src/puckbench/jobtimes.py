"""How long the jobs of a finished run took, and how long those of another would take.

Snakemake keeps a record of each file that it made, with when its job began and ended. What is
estimated from them is the life of whole processes, imports included, on the machine of that run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.cloud import Floats
from puckbench.errors import InputError
from puckbench.files import read_json

_OF_CELLS = ("encode", "evaluate", "decode")
_OF_CLOUDS = ("sample", "scan", "prepare", *_OF_CELLS)
"""Rules whose work grows with the points of a cloud."""


@dataclass(frozen=True)
class JobTime:
    """One finished job. codec, rate: empty where it has none. points: of its cloud, 0 if none."""

    rule: str
    codec: str
    rate: str
    points: int
    seconds: float


@dataclass(frozen=True)
class JobKind:
    """Jobs of a plan that are alike: so many, with about so many points each."""

    rule: str
    jobs: int
    points: int = 0
    codec: str = ""
    rate: str = ""


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
    def of(cls, times: Iterable[JobTime]) -> Measurements:
        """Those of some jobs."""
        rows = [(time.points, time.seconds) for time in times]
        table = np.array(rows, dtype=np.float64).reshape(-1, 2)
        return cls(table[:, 0], table[:, 1])

    def at(self, points: int) -> float:
        """Seconds of a job with so many points: a start and a time for each point.

        With clouds of one size alone, a larger one takes longer in proportion.
        """
        start, slope = self._line
        return start + slope * points

    @cached_property
    def _line(self) -> tuple[float, float]:
        x, mean, middle = self.points, float(self.seconds.mean()), float(self.points.mean())
        if middle == 0:
            return mean, 0.0
        spread = float(np.sum((x - middle) ** 2))
        if spread <= (0.01 * middle) ** 2 * len(x):
            return 0.0, mean / middle
        slope = float(np.sum((x - middle) * (self.seconds - mean))) / spread
        slope = min(max(slope, 0.0), mean / middle)  # neither start nor slope is below 0
        return mean - slope * middle, slope


def read_job_times(run: Path) -> list[JobTime]:
    """The jobs of the runs made in a folder; InputError when Snakemake kept no records there."""
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
    seconds = float(record["endtime"]) - float(record["starttime"])
    if rule not in _OF_CLOUDS:
        return JobTime(rule, "", "", 0, seconds)
    results, _, names = str(log.with_suffix("")).partition("/logs/")
    dataset, cloud, *cell = names.split("/")[1:]
    codec, rate = cell if rule in _OF_CELLS else ("", "")
    return JobTime(rule, codec, rate, _points(run / results, dataset, cloud), seconds)


def _points(results: Path, dataset: str, cloud: str) -> int:
    about = results / "clouds" / dataset / f"{cloud}.json"
    return int(read_json(about)["points"]) if about.exists() else 0


def estimated(kinds: Iterable[JobKind], times: Iterable[JobTime]) -> list[Estimate]:
    """What every kind of job would take, from the times of a run."""
    by_rate: dict[tuple[str, str, str], list[JobTime]] = {}
    by_codec: dict[tuple[str, str], list[JobTime]] = {}
    for time in times:
        if time.rule in _OF_CLOUDS and not time.points:
            continue
        by_rate.setdefault((time.rule, time.codec, time.rate), []).append(time)
        by_codec.setdefault((time.rule, time.codec), []).append(time)
    return [_estimate(kind, by_rate, by_codec) for kind in kinds]


def _estimate(
    kind: JobKind,
    by_rate: Mapping[tuple[str, str, str], list[JobTime]],
    by_codec: Mapping[tuple[str, str], list[JobTime]],
) -> Estimate:
    own = by_rate.get((kind.rule, kind.codec, kind.rate))
    times = own or by_codec.get((kind.rule, kind.codec))
    if not times:
        return Estimate(kind, None)
    found = Measurements.of(times)
    largest = float(found.points.max())
    reach = kind.points / largest if largest else 0.0
    return Estimate(kind, found.at(kind.points), len(times), reach, own is not None)

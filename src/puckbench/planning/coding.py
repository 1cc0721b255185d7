from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from pointkit.geometry.cloud import CoordinateFrame
from puckbench.codecs.rates import rates_of
from puckbench.codecs.registry import module_of
from puckbench.core.environment import thread_environment
from puckbench.jobs.decode import Decode
from puckbench.jobs.decode_shown import DecodeShown
from puckbench.jobs.encode_curve import EncodeCurve
from puckbench.jobs.evaluate import Evaluate, EvaluateCurve
from puckbench.jobs.recovery import RecoveryCurve
from puckbench.jobs.registry import Job
from puckbench.metrics.metric_registry import METRICS
from puckbench.planning.clouds import CloudJobs
from puckbench.planning.config import DataSetConfig
from puckbench.planning.costs import costs_of
from puckbench.planning.plan import Plan
from puckbench.planning.planned_job import PlannedJob, planned
from puckbench.planning.report_contents import shown_rates

_BYTES_PER_PIXEL = 100
"""Memory per pixel of a square view, bytes (measured: 305 MB for a width of 1920)."""


def _peak(settings: DataSetConfig) -> float | None:
    if settings.peak is not None or isinstance(settings.size, str):
        return settings.peak
    return float(settings.size) - 1


class CodingJobs:
    """Plans the jobs that encode and decode clouds, and that measure the decoded clouds.

    Parameters
    ----------
    clouds
        The planned jobs that make the clouds.
    """

    def __init__(self, clouds: CloudJobs) -> None:
        self.clouds, self.plan = clouds, clouds.plan
        self.timing = self.plan.config.timing

    def rows(self, kind: str, codec: str | None = None) -> tuple[str, ...]:
        """Return the files with rows of results, relative to the results folder.

        Parameters
        ----------
        kind
            ``metrics`` for measurements of decoded clouds, ``recovery`` for decoded primitives.
        codec
            Name of the codec; by default, the files of all codecs are returned.
        """
        curves = self.plan.recovered if kind == "recovery" else self.plan.curves
        return tuple(
            f"{kind}/{'/'.join(curve)}.parquet" for curve in curves if codec in (None, curve[2])
        )

    def artefacts(self) -> list[str]:
        """Return the files with streams and results, relative to the results folder."""
        coded = [f"coded/{'/'.join(curve)}.zip" for curve in self.plan.curves]
        return [*coded, *self.rows("metrics"), *self.rows("recovery")]

    def _seconds(self, codec: str) -> float:
        return self.timing.repeats * costs_of(self.plan.opened[codec]).seconds_of(self._most_points)

    @cached_property
    def _most_points(self) -> int:
        return max((data.points for data in self.plan.datasets.values()), default=0)

    @cache  # noqa: B019
    def minutes(self, codec: str) -> int:
        """Return the time, in minutes, to request for coding a cloud at all rates of a codec."""
        rates = max((len(self.plan.rates(codec, frame)) for frame in self.plan.frames), default=0)
        return 5 + math.ceil(2 * rates * self._seconds(codec) / 60)

    def encode(self, dataset: str, cloud: str, codec: str) -> PlannedJob:
        """Plan the job that encodes a cloud at all planned rates of a codec."""
        rates = self.plan.curve_rates(dataset, cloud, codec)
        record = EncodeCurve(
            codec=codec, changes=self._entry(dataset, codec, rates), **timed(self.plan)
        )
        return codec_job(self.plan, record, codec)

    def decode(self, dataset: str, codec: str, rate: str) -> PlannedJob:
        """Plan the job that decodes one rate of a curve to a cloud file."""
        record = Decode(codec=codec, changes=self._entry(dataset, codec, (rate,)), rate=rate)
        return codec_job(self.plan, record, codec)

    def decode_shown(self, dataset: str, cloud: str, codec: str) -> PlannedJob:
        """Plan the job that decodes a cloud at the rates that the report shows."""
        rates = shown_rates(self.plan, dataset, cloud, codec)
        changes = self._entry(dataset, codec, rates)
        return codec_job(self.plan, DecodeShown(codec=codec, changes=changes, rates=rates), codec)

    def evaluate(self, dataset: str, cloud: str, codec: str) -> PlannedJob:
        """Plan the job that decodes a cloud at all rates, and measures the decoded clouds."""
        rates = self.plan.curve_rates(dataset, cloud, codec)
        settings = self.clouds.dataset(dataset).settings
        record = EvaluateCurve(
            dataset=dataset,
            codec=codec,
            changes=self._entry(dataset, codec, rates),
            peak=_peak(settings),
            views=settings.views,
            metrics=self.plan.config.metrics,
            **timed(self.plan),
        )
        modules = map(METRICS.module_of, record.metrics)
        return codec_job(self.plan, record, codec, *modules, also=self.truth_kinds(dataset))

    def recovery(self, dataset: str, codec: str) -> PlannedJob:
        """Plan the job that compares decoded geometric primitives with a scene's labels."""
        changes = self._entry(dataset, codec, self.plan.rates(codec, self._frame(dataset)))
        record = RecoveryCurve(dataset=dataset, codec=codec, changes=changes)
        return codec_job(self.plan, record, codec)

    def scan_error(self, dataset: str) -> PlannedJob:
        """Plan the job that compares a scan with the true surface, before any coding."""
        return planned(Evaluate(dataset=dataset), also=self.truth_kinds(dataset))

    def cloud(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the files of a prepared cloud and what lies beside it, as in `described`."""
        return self.described({"cloud": f"{self.plan.results}/clouds/{dataset}/{cloud}.ply"})

    def described(self, files: Mapping[str, str]) -> dict[str, str]:
        """Return files by input name, with the files that a job reads beside them.

        For an input ``cloud``, these are its description, as ``cloud_about``, and the sensor's
        returns, if any, as ``cloud_returns``.
        """
        beside = {}
        for name, path in ((name, Path(file)) for name, file in files.items()):
            if path.suffix == ".ply":
                beside[f"{name}_about"] = str(path.with_suffix(".json"))
            if path.parent in self._clouds_with_returns:
                beside[f"{name}_returns"] = str(path.with_suffix(".parquet"))
        return {**files, **beside}

    @cached_property
    def _clouds_with_returns(self) -> frozenset[Path]:
        folder = self.plan.results / "clouds"
        return frozenset(folder / name for name in self.clouds.prepared(has_returns=True))

    def truth(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the files with the truth about a cloud, by input name; empty without truth.

        ``truth`` is the true surface, in the scene's file. ``clean``, for a scan, or ``visible``,
        otherwise, is a cloud with the true position of each point.
        """
        data = self.clouds.dataset(dataset)
        if not data.has_truth:
            return {}
        seen = "clean" if data.is_scanned_from_truth else "visible"
        points = {seen: self.clouds.true_points(dataset, cloud)}
        if not data.has_true_surface:
            return points
        return {"truth": self.clouds.scene_file(dataset, cloud), **points}

    def truth_kinds(self, dataset: str) -> str:
        """Return the input names that `truth` has for the clouds of a data set, in one line."""
        return " ".join(self.truth(dataset, self.clouds.dataset(dataset).clouds[0]))

    def labels(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the files with the labelled true points of a cloud, and with its scene."""
        return {
            "points": self.clouds.true_points(dataset, cloud),
            "scene": self.clouds.scene_file(dataset, cloud),
        }

    @property
    def threads_environment(self) -> dict[str, str]:
        """Environment variables that limit the threads of a timed job."""
        return thread_environment(self.timing.threads)

    def cores(self, cores: int | None) -> int:
        """Return the number of cores that a timed job reserves.

        `cores` is the number of cores of the run. With the setting ``timing: exclusive``, a job
        reserves all of them, so that no other job runs at the same time.
        """
        threads = self.timing.threads
        return max(threads, cores or 0) if self.timing.exclusive else threads

    @cache  # noqa: B019
    def memory_mb(self, codec: str) -> int:
        """Return the estimated memory (MB) of a job that codes the largest cloud of the run."""
        views = max((data.settings.views for data in self.plan.datasets.values()), default=0)
        pictures = views**2 * _BYTES_PER_PIXEL // 1_000_000
        return (
            max(
                costs_of(self.plan.opened[codec]).memory_of(self._most_points),
                self._cloud_memory_mb,
            )
            + pictures
        )

    @cached_property
    def _cloud_memory_mb(self) -> int:
        return max(map(self.clouds.memory_mb, self.plan.datasets), default=0)

    def _frame(self, dataset: str) -> CoordinateFrame:
        return self.plan.datasets[dataset].frame

    def _entry(self, dataset: str, codec: str, rates: tuple[str, ...]) -> dict[str, Any]:
        table = rates_of(self.plan.opened[codec], self._frame(dataset))
        return self.plan.entry_with(codec, {rate: table[rate] for rate in rates})


def codec_job(plan: Plan, record: Job, codec: str, *modules: str, also: object = "") -> PlannedJob:
    """Plan a job that uses a codec, so that it runs again if the codec's code or weights change.

    Parameters
    ----------
    plan
        The plan of the run.
    record
        The job with its settings.
    codec
        Name of the codec in the configuration.
    modules
        Names of further modules whose code the job uses.
    also
        Other data on which the results depend, such as digests of input files.
    """
    module, weights = module_of(plan.codecs[codec]["class"]), plan.weights_digest(codec)
    is_timed = "repeats" in type(record).model_fields
    threads = plan.config.timing.threads if is_timed else ""
    return planned(record, module, *modules, also=f"{weights} {also} {threads}".strip())


def timed(plan: Plan) -> dict[str, Any]:
    """Return settings of `TimedJob`: the number of repetitions, and whether jobs run alone."""
    return {"repeats": plan.config.timing.repeats, "alone": plan.config.timing.exclusive}

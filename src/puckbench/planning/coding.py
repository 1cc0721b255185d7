"""Jobs of codecs: rate-distortion curves of a cloud and a codec, coded, decoded and measured."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from puckbench.codecs.base import Pace
from puckbench.codecs.registry import memory_mb, module_of, pace
from puckbench.core.environment import thread_environment
from puckbench.core.files import sha256
from puckbench.geometry.cloud import Frame
from puckbench.jobs.decode import Decode, DecodeShown
from puckbench.jobs.encode import EncodeCurve
from puckbench.jobs.evaluate import Evaluate, EvaluateCurve
from puckbench.jobs.join_parts import JoinRows, JoinStreams
from puckbench.jobs.joined import RowsTable
from puckbench.jobs.recovery import RecoveryCurve
from puckbench.metrics.further import METRICS
from puckbench.planning.clouds import CloudJobs
from puckbench.planning.planned_job import PlannedJob, planned
from puckbench.planning.report_contents import shown_rates

_BYTES_PER_PIXEL = 100
"""Of the six pictures' width times height, one at a time: 305 MB were measured at 1920 pixels."""
_MOST_SECONDS = 600
"""Of one job's coding and decoding, as estimated: a curve that takes longer is cut by rates."""


@dataclass(frozen=True)
class Curve:
    """Rates of a codec, in a frame, that one job codes and one measures: all, or a part of them."""

    codec: str
    frame: Frame
    rates: tuple[str, ...]

    @property
    def part(self) -> str:
        """Its rates, in a name."""
        first, last = self.rates[0], self.rates[-1]
        return first if first == last else f"{first}_to_{last}"


class CodingJobs:
    """Files and jobs of the curves."""

    def __init__(self, clouds: CloudJobs) -> None:
        self.clouds, self.plan = clouds, clouds.plan
        self.timing = self.plan.config.timing

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """The curves of every codec in every frame, those that would take too long in parts."""
        return tuple(
            Curve(codec, frame, rates)
            for frame in self.plan.frames
            for codec in self._coding(frame)
            for rates in _parts(self.plan.rates(codec, frame), self._seconds(codec))
        )

    def _coding(self, frame: Frame) -> list[str]:
        """The codecs that code any data set in a frame."""
        sets = self.plan.in_frame(frame)
        codes = self.plan.codes
        return [codec for codec in self.plan.codecs if any(codes(codec, name) for name in sets)]

    @cached_property
    def cut(self) -> list[str]:
        """The codecs of which any curve is coded and measured in parts."""
        counts = Counter((curve.codec, curve.frame) for curve in self.curves)
        return list(dict.fromkeys(codec for (codec, _), count in counts.items() if count > 1))

    @cached_property
    def whole(self) -> list[str]:
        """The codecs of which every curve is coded and measured by one job."""
        return [codec for codec in self.plan.codecs if codec not in self.cut]

    @cache  # noqa: B019 (one plan lives as long as the process)
    def parts(self, dataset: str, codec: str) -> dict[str, Curve]:
        """The parts of a codec's curves on a data set's clouds, by their names."""
        frame = self.plan.datasets[dataset].frame
        chosen = [curve for curve in self.curves if (curve.codec, curve.frame) == (codec, frame)]
        return {curve.part: curve for curve in chosen}

    def rows(self, kind: str, codec: str | None = None) -> tuple[str, ...]:
        """The file of each curve's rows below the results folder, in the order of the table.

        kind: ``metrics`` or ``recovery``. codec: whose, if not of all.
        """
        curves = self.plan.recovered if kind == "recovery" else self.plan.curves
        return tuple(
            f"{kind}/{'/'.join(curve)}.parquet" for curve in curves if codec in (None, curve[2])
        )

    def _seconds(self, codec: str) -> float:
        """Estimate of what coding and decoding the largest clouds takes at one rate."""
        return self.timing.repeats * self.pace(codec).of(self._most_points)

    @cached_property
    def _most_points(self) -> int:
        """Points of the largest clouds."""
        return max((data.points for data in self.plan.datasets.values()), default=0)

    def pace(self, codec: str) -> Pace:
        """Estimate of the time that a codec takes at one rate."""
        return pace(codec, self.plan.config.codec(codec))

    @cache  # noqa: B019
    def minutes(self, codec: str) -> int:
        """Generous estimate of the time of a curve's job, for the largest clouds, in minutes."""
        rates = max((len(curve.rates) for curve in self.curves if curve.codec == codec), default=0)
        return 5 + math.ceil(2 * rates * self._seconds(codec) / 60)

    @cache  # noqa: B019
    def encode(self, dataset: str, codec: str, part: str = "") -> PlannedJob:
        """Code a cloud at all rates, or those of a part."""
        record = EncodeCurve(codec=codec, changes=self._entry(dataset, codec, part), **self._timed)
        return planned(record, self._module(codec), also=self._weights(codec))

    @cache  # noqa: B019
    def decode(self, dataset: str, codec: str, rate: str) -> PlannedJob:
        """Decode the stream of a rate to a cloud."""
        record = Decode(codec=codec, changes=self._entry(dataset, codec), rate=rate)
        return planned(record, self._module(codec), also=self._weights(codec))

    @cache  # noqa: B019
    def decode_shown(self, dataset: str, codec: str) -> PlannedJob:
        """Decode the streams of the rates that the report shows."""
        rates = shown_rates(self.plan, codec, self.plan.datasets[dataset].frame)
        changes = self._entry(dataset, codec)
        record = DecodeShown(codec=codec, changes=changes, rates=tuple(rates))
        return planned(record, self._module(codec), also=self._weights(codec))

    @cache  # noqa: B019
    def evaluate(self, dataset: str, codec: str, part: str = "") -> PlannedJob:
        """Measure the streams of a curve, or of a part of it."""
        settings = self.clouds.dataset(dataset).settings
        record = EvaluateCurve(
            dataset=dataset,
            codec=codec,
            changes=self._entry(dataset, codec, part),
            peak=None if isinstance(settings.size, str) else float(settings.size) - 1,
            views=settings.views,
            metrics=self.plan.config.metrics,
            **self._timed,
        )
        modules = (self._module(codec), *map(METRICS.module_of, record.metrics))
        return planned(record, *modules, also=self._weights(codec))

    @cache  # noqa: B019
    def recovery(self, dataset: str, codec: str) -> PlannedJob:
        """Compare the primitives of a curve's streams with those of the scene."""
        changes = self._entry(dataset, codec)
        record = RecoveryCurve(dataset=dataset, codec=codec, changes=changes)
        return planned(record, self._module(codec), also=self._weights(codec))

    @cached_property
    def join_streams(self) -> PlannedJob:
        """Join the streams of a curve's parts."""
        return planned(JoinStreams())

    @cached_property
    def join_rows(self) -> PlannedJob:
        """Join the result rows of a curve's parts."""
        return planned(JoinRows())

    @cache  # noqa: B019
    def scan_error(self, dataset: str) -> PlannedJob:
        """Measure a scan as if it had been decoded."""
        return planned(Evaluate(dataset=dataset))

    def cloud(self, dataset: str, cloud: str) -> dict[str, str]:
        """Files of a prepared cloud: its points, their description and, of a sensor's, returns."""
        return self.described({"cloud": f"{self.plan.results}/clouds/{dataset}/{cloud}.ply"})

    def described(self, files: Mapping[str, str]) -> dict[str, str]:
        """Files by name, each cloud and mesh with what a reader looks for beside it.

        That is its description and, of prepared clouds of a sensor's returns, these.
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
        """Further inputs of a measurement: the true surface and what the sensor saw of it."""
        data = self.clouds.dataset(dataset)
        if not data.has_truth:
            return {}
        seen = "clean" if data.is_scanned_from_truth else "visible"
        points = {seen: self.clouds.true_points(dataset, cloud)}
        if not data.has_true_surface:
            return points
        return {"truth": self.clouds.scene_file(dataset, cloud), **points}

    def labels(self, dataset: str, cloud: str) -> dict[str, str]:
        """Further inputs where primitives are compared: labelled points and their scene."""
        return {
            "points": self.clouds.true_points(dataset, cloud),
            "scene": self.clouds.scene_file(dataset, cloud),
        }

    def tables(self) -> Iterator[RowsTable]:
        """The tables of all result rows of a kind."""
        if self.plan.datasets:
            yield RowsTable(kind="metrics", names=self.rows("metrics"))
        if self.plan.scanned:
            names = map("/".join, self.plan.scanned)
            yield RowsTable(
                kind="scan_errors", names=tuple(f"scan_errors/{name}.json" for name in names)
            )
        if self.plan.recovered:
            yield RowsTable(kind="recovery", names=self.rows("recovery"))

    @property
    def threads_environment(self) -> dict[str, str]:
        """Additions to the environment of a timed job: the threads that libraries may use."""
        return thread_environment(self.timing.threads)

    def cores(self, cores: int | None) -> int:
        """Cores that a timed job takes of those of the run: all where it is to run alone.

        cores: of the run; None where a cluster's nodes, not this machine, run the jobs.
        """
        threads = self.timing.threads
        return max(threads, cores or 0) if self.timing.exclusive else threads

    @cache  # noqa: B019
    def memory_mb(self, codec: str) -> int:
        """Estimate of the memory of a curve's job in MB: of the codec and the pictures.

        For the largest clouds: a function for each of very many jobs would cost planning more.
        """
        views = max((data.settings.views for data in self.plan.datasets.values()), default=0)
        changes = self.plan.config.codec(codec)
        pictures = views**2 * _BYTES_PER_PIXEL // 1_000_000
        return max(memory_mb(codec, self._most_points, changes), self._cloud_memory_mb) + pictures

    @cached_property
    def _cloud_memory_mb(self) -> int:
        return max(map(self.clouds.memory_mb, self.plan.datasets), default=0)

    @property
    def _timed(self) -> dict[str, Any]:
        return {"repeats": self.timing.repeats, "alone": self.timing.exclusive}

    def _entry(self, dataset: str, codec: str, part: str = "") -> dict[str, Any]:
        """The codec's whole entry, with the rates for a data set's frame, or of a part, alone."""
        entry = {**self.plan.codecs[codec]}
        table = self.plan.opened[codec].rates_of(self.plan.datasets[dataset].frame)
        names = self.parts(dataset, codec)[part].rates if part else table
        chosen = {rate: table[rate] for rate in names}
        lengths = entry.pop("metric_rates", {})
        if chosen.keys() <= lengths.keys():
            return {**entry, "rates": {}, "metric_rates": chosen}
        return {**entry, "rates": chosen}

    def _module(self, codec: str) -> str:
        return module_of(self.plan.codecs[codec]["class"])

    @cache  # noqa: B019
    def _weights(self, codec: str) -> str:
        """Digests of a codec's weights, where it has any."""
        return " ".join(map(sha256, self.plan.weights[codec]))


def _parts(rates: tuple[str, ...], seconds: float) -> list[tuple[str, ...]]:
    """Rates in parts that each keep within the most seconds; none without rates.

    seconds: of one rate.
    """
    parts = max(1, min(len(rates), math.ceil(seconds * len(rates) / _MOST_SECONDS)))
    size = math.ceil(len(rates) / parts)
    return [rates[first : first + size] for first in range(0, len(rates), size or 1)]

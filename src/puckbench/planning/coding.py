"""Jobs of codecs: rate-distortion curves of a cloud and a codec, coded, decoded and measured."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

from puckbench.codecs.base import Pace
from puckbench.codecs.registry import memory_mb, module_of, pace
from puckbench.core.environment import thread_environment
from puckbench.core.files import sha256
from puckbench.geometry.cloud import Frame
from puckbench.jobs.decode import Decode
from puckbench.jobs.encode import EncodeCurve
from puckbench.jobs.evaluate import Evaluate, EvaluateCurve
from puckbench.jobs.evaluate_surfaces import EvaluateSurfaces
from puckbench.jobs.joined import RowsTable
from puckbench.metrics.further import METRICS
from puckbench.planning.clouds import CloudJobs
from puckbench.planning.config import DataSetConfig
from puckbench.planning.planned_job import PlannedJob, planned
from puckbench.planning.report_contents import shown_rates

_BYTES_PER_PIXEL = 100
"""Of the six pictures' width times height, one at a time: 305 MB were measured at 1920 pixels."""
_KINDS_OF_FILES = (("coded", ".bin"), ("metrics", ".json"), ("recovery", ".json"))
_MOST_SECONDS = 600
"""Of one job's coding and decoding, as estimated: a curve that takes longer is cut by rates."""


@dataclass(frozen=True)
class Curve:
    """Rates of a codec that one job codes, and one measures: a whole curve, or a part of it."""

    codec: str
    rates: tuple[str, ...]
    whole: bool
    frame: Frame = "scaled"

    def name(self, what: str) -> str:
        """The name of a rule, such as ``encode_draco``, ``encode_draco_metric``."""
        words = [what, self.codec, *(["metric"] if self.frame == "metric" else [])]
        return "_".join(words if self.whole else [*words, self.part])

    @property
    def log(self) -> str:
        """Name of a log, below those of the data set and the cloud."""
        return self.codec if self.whole else f"{self.codec}/{self.part}"

    @property
    def part(self) -> str:
        """Its rates, in a name."""
        first, last = self.rates[0], self.rates[-1]
        return first if first == last else f"{first}_to_{last}"

    def alone(self) -> list[Curve]:
        """Each of its rates."""
        return [replace(self, rates=(rate,), whole=False) for rate in self.rates]

    def files(self, folder: str, suffix: str) -> list[str]:
        """A file for each rate, of any data set and cloud."""
        return [
            f"{folder}/{{dataset}}/{{cloud}}/{self.codec}/{rate}{suffix}" for rate in self.rates
        ]

    def first(self, folder: str, suffix: str) -> str:
        """The file of the first rate, which stands for all as an input of other jobs.

        They are made together, there are tens of thousands of them, and Snakemake's planning pays
        for each input of each job.
        """
        return self.files(folder, suffix)[0]


@dataclass(frozen=True)
class Measuring:
    """What a rule measures: a curve of every cloud of some data sets, or of one cloud.

    surfaces: whether the primitives are compared with the scenes'. example: the kind of example
    that the cloud is. shown: rates whose decoded clouds the report shows, which are written too.
    """

    curve: Curve
    datasets: tuple[str, ...]
    surfaces: bool
    cloud: str | None = None
    example: str = ""
    shown: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The name of the rule, such as ``evaluate_draco`` and ``evaluate_draco_object``."""
        words = [self.curve.name("evaluate"), "surfaces" if self.surfaces else "", self.example]
        return "_".join(filter(None, words))

    def place(self, wildcards: Any) -> tuple[str, str]:
        """The data set and the cloud of a job."""
        if self.cloud is None:
            return wildcards.dataset, wildcards.cloud
        return self.datasets[0], self.cloud

    def job(self, wildcards: Any) -> tuple[str, Curve, bool]:
        """What `CodingJobs.evaluate` plans a job for."""
        return self.place(wildcards)[0], self.curve, self.surfaces

    def of(self, *paths: str) -> list[str]:
        """Paths with the data set and the cloud in them, where the rule has one cloud."""
        if self.cloud is None:
            return [*paths]
        return [path.format(dataset=self.datasets[0], cloud=self.cloud) for path in paths]

    def outputs(self, results: str) -> dict[str, list[str]]:
        """Files that a job is told to make, by the keys of its arguments."""
        files = {"rows": self.curve.files(f"{results}/metrics", ".json")}
        if self.surfaces:
            files["recovered"] = self.curve.files(f"{results}/recovery", ".json")
        if self.shown:
            files["clouds"] = self._shown(results, ".ply")
        return {key: self.of(*paths) for key, paths in files.items()}

    def beside(self, results: str) -> list[str]:
        """The descriptions of the decoded clouds, which are written beside them."""
        return self.of(*self._shown(results, ".json"))

    def _shown(self, results: str, suffix: str) -> list[str]:
        return replace(self.curve, rates=self.shown).files(f"{results}/decoded", suffix)


def _peak(settings: DataSetConfig) -> float | None:
    """Peak of the PSNRs of a data set; None where each cloud's description has it."""
    if settings.peak is not None or isinstance(settings.size, str):
        return settings.peak
    return float(settings.size) - 1


class CodingJobs:
    """Files and jobs of the curves."""

    def __init__(self, clouds: CloudJobs) -> None:
        self.clouds, self.plan = clouds, clouds.plan
        self.timing = self.plan.config.timing

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """The curves of every codec, those that would take too long in parts."""
        return tuple(
            replace(curve, frame=frame)
            for frame in self.plan.frames
            for codec in self._coding(frame)
            for curve in _curves(codec, self._alike(codec, frame), self._seconds(codec))
        )

    def _alike(self, codec: str, frame: Frame) -> list[tuple[str, ...]]:
        """The rates of a codec, cut where it codes other clouds."""
        without: dict[str, set[tuple[str, str]]] = {}
        for (*cloud, coder), rates in self.plan.too_wide.items():
            for rate in rates if coder == codec and frame == "metric" else ():
                without.setdefault(rate, set()).add((cloud[0], cloud[1]))
        every = groupby(self.plan.rates(codec, frame), lambda rate: without.get(rate, set()))
        return [tuple(rates) for _, rates in every]

    def _coding(self, frame: Frame) -> list[str]:
        """The codecs that code any data set in a frame."""
        sets = self.plan.in_frame(frame)
        codes = self.plan.codes
        return [codec for codec in self.plan.codecs if any(codes(codec, name) for name in sets)]

    def datasets(self, curve: Curve) -> list[str]:
        """The data sets that a curve is of."""
        sets = self.plan.in_frame(curve.frame)
        return [name for name in sets if self.plan.codes(curve.codec, name)]

    def _codes(self, curve: Curve, dataset: str, cloud: str) -> bool:
        """Whether a curve is coded of a cloud of one of its data sets."""
        return self.plan.is_coded(dataset, cloud, curve.codec, curve.rates[0])

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

    @cache  # noqa: B019 (one plan lives as long as the process)
    def minutes(self, curve: Curve) -> int:
        """Generous estimate of the time of a curve's job, for the largest clouds, in minutes."""
        return 5 + math.ceil(2 * len(curve.rates) * self._seconds(curve.codec) / 60)

    @cached_property
    def measuring(self) -> tuple[Measuring, ...]:
        """What rules measure: of clouds that the report shows some decoded ones are written too."""
        return tuple(
            one
            for curve in self.curves
            for surfaces in (False, True)
            if (datasets := self.measured(curve, surfaces))
            for one in (
                Measuring(curve, tuple(datasets), surfaces),
                *self._examples(curve, datasets, surfaces),
            )
        )

    def _examples(self, curve: Curve, datasets: list[str], surfaces: bool) -> Iterator[Measuring]:
        rates = shown_rates(self.plan, curve.codec, curve.frame)
        shown = tuple(rate for rate in curve.rates if rate in rates)
        # The same cloud may be an example of two kinds.
        kinds = {name: kind for kind, name in self.plan.config.figures.examples.given().items()}
        for name, kind in kinds.items():
            dataset, cloud = name.split("/")
            if dataset in datasets and self._codes(curve, dataset, cloud):
                yield Measuring(curve, (dataset,), surfaces, cloud, kind, shown)

    @cache  # noqa: B019
    def encode(self, curve: Curve) -> PlannedJob:
        """Code a cloud."""
        record = EncodeCurve(codec=curve.codec, changes=self._entry(curve), **self._timed)
        return planned(record, self._module(curve.codec), also=self._weights(curve.codec))

    @cache  # noqa: B019
    def decode(self, curve: Curve) -> PlannedJob:
        """Decode a stream to a cloud."""
        record = Decode(codec=curve.codec, changes=self._entry(curve))
        return planned(record, self._module(curve.codec), also=self._weights(curve.codec))

    @cache  # noqa: B019
    def evaluate(self, dataset: str, curve: Curve, surfaces: bool = False) -> PlannedJob:
        """Measure streams; with `surfaces` the primitives that they are made of as well."""
        settings = self.clouds.dataset(dataset).settings
        job = EvaluateSurfaces if surfaces else EvaluateCurve
        record = job(
            dataset=dataset,
            codec=curve.codec,
            changes=self._entry(curve),
            peak=_peak(settings),
            views=settings.views,
            metrics=self.plan.config.metrics,
            **self._timed,
        )
        modules = (self._module(curve.codec), *map(METRICS.module_of, record.metrics))
        return planned(record, *modules, also=self._weights(curve.codec))

    @cache  # noqa: B019
    def scan_error(self, dataset: str) -> PlannedJob:
        """Measure a scan as if it had been decoded."""
        return planned(Evaluate(dataset=dataset))

    def measured(self, curve: Curve, surfaces: bool) -> list[str]:
        """Data sets of a curve: those whose primitives are compared with the scenes', or others."""
        compared = self.plan.labelled if curve.codec in self.plan.of_surfaces else ()
        return [name for name in self.datasets(curve) if (name in compared) == surfaces]

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

    def lost_files(self) -> list[str]:
        """Streams and rows that are gone, of curves whose first ones, which jobs follow, are there.

        Looked for by what asks for all files of a run, so that Snakemake makes them again.
        """
        rates = self.rates()
        firsts = (
            Path(row).with_suffix(suffix)
            for kind, suffix in _KINDS_OF_FILES
            for row in self.first_rows(kind)
        )
        return [
            str(path)
            for first in firsts
            if first.exists()
            for rate in rates[f"{first.parent.name}/{first.stem}"]
            if not (path := first.with_stem(rate)).exists()
        ]

    def first_rows(self, kind: str, codec: str | None = None) -> list[str]:
        """The first row of each curve, of all clouds in the order of the table.

        kind: of the rows, or ``coded`` for names as of the streams. codec: whose, if not of all.
        """
        folder = f"{self.plan.results}/{kind}"
        return [
            curve.first(folder, ".json").format(dataset=dataset, cloud=cloud)
            for dataset, cloud in self.plan.clouds
            for curve in self.curves
            if codec in (None, curve.codec)
            and dataset in self.datasets(curve)
            and self._codes(curve, dataset, cloud)
            and (kind != "recovery" or dataset in self.measured(curve, surfaces=True))
        ]

    def rates(self, codec: str | None = None) -> dict[str, tuple[str, ...]]:
        """Rates of curves by codec and first rate ("draco/r1"); codec: of this one alone."""
        return {
            f"{curve.codec}/{curve.rates[0]}": curve.rates
            for curve in self.curves
            if codec in (None, curve.codec)
        }

    def tables(self) -> Iterator[tuple[RowsTable, list[str]]]:
        """The tables that are made of result rows of their own, and the files of these rows."""
        if self.plan.scanned:
            names = map("/".join, self.plan.scanned)
            rows = [f"{self.plan.results}/scan_errors/{name}.json" for name in names]
            yield RowsTable(kind="scan_errors"), rows
        if self.plan.recovered:
            yield RowsTable(kind="recovery", rates=self.rates()), self.first_rows("recovery")

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

    def _entry(self, curve: Curve) -> dict[str, Any]:
        """The codec's whole entry with the curve's rates alone."""
        entry = {**self.plan.codecs[curve.codec]}
        table = self.plan.opened[curve.codec].rates_of(curve.frame)
        chosen = {rate: table[rate] for rate in curve.rates}
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


def _curves(codec: str, groups: list[tuple[str, ...]], seconds: float) -> list[Curve]:
    """A curve of each group of rates, or parts of it that each keep within the most seconds.

    seconds: of one rate.
    """
    cut = []
    for rates in groups:
        parts = min(len(rates), math.ceil(seconds * len(rates) / _MOST_SECONDS))
        size = math.ceil(len(rates) / max(1, parts))
        cut += [rates[first : first + size] for first in range(0, len(rates), size)]
    return [Curve(codec, part, whole=len(cut) == 1) for part in cut]

"""Jobs of codecs: streams, decoded clouds, result rows, recovered primitives."""

from __future__ import annotations

from functools import cache, cached_property
from typing import Any

from puckbench.codecs.registry import memory_mb, module_of
from puckbench.core.environment import thread_environment
from puckbench.core.files import sha256
from puckbench.geometry.scaling import GRID
from puckbench.jobs.decode import Decode
from puckbench.jobs.encode import Encode
from puckbench.jobs.evaluate import Evaluate
from puckbench.jobs.joined import RowKind
from puckbench.jobs.recovery import Recovery
from puckbench.metrics.further import METRICS
from puckbench.planning.clouds import CloudJobs
from puckbench.planning.planned_job import PlannedJob, planned

_BYTES_PER_PIXEL = 100
"""Of the six pictures' width times height, one at a time: 305 MB were measured at 1920 pixels."""


class CodingJobs:
    """Files and jobs of the cells: cloud, codec and rate."""

    def __init__(self, clouds: CloudJobs) -> None:
        self.clouds, self.plan = clouds, clouds.plan
        self.timing = self.plan.config.timing

    @cache  # noqa: B019 (one plan lives as long as the process)
    def encode(self, codec: str, rate: str) -> PlannedJob:
        """Code a cloud."""
        record = Encode(codec=codec, rate=rate, changes=self._entry(codec, rate), **self._timed)
        return planned(record, self._module(codec), also=self._weights(codec))

    @cache  # noqa: B019
    def decode(self, codec: str, rate: str) -> PlannedJob:
        """Decode a stream to a cloud."""
        record = Decode(codec=codec, changes=self._entry(codec, rate))
        return planned(record, self._module(codec), also=self._weights(codec))

    @cache  # noqa: B019
    def evaluate(self, dataset: str, codec: str, rate: str) -> PlannedJob:
        """Measure a stream."""
        settings = self.clouds.dataset(dataset).settings
        record = Evaluate(
            dataset=dataset,
            codec=codec,
            changes=self._entry(codec, rate),
            peak=None if settings.size == GRID else float(settings.size) - 1,
            views=settings.views,
            metrics=self.plan.config.metrics,
            **self._timed,
        )
        modules = (self._module(codec), *map(METRICS.module_of, record.metrics))
        return planned(record, *modules, also=self._weights(codec))

    @cache  # noqa: B019
    def scan_error(self, dataset: str) -> PlannedJob:
        """Measure a scan as if it had been decoded."""
        return planned(Evaluate(dataset=dataset))

    @cache  # noqa: B019
    def recovery(self, dataset: str, codec: str, rate: str) -> PlannedJob:
        """Compare the primitives of a stream with the scene's."""
        record = Recovery(dataset=dataset, codec=codec, changes=self._entry(codec, rate))
        return planned(record, self._module(codec), also=self._weights(codec))

    def truth(self, dataset: str, cloud: str) -> dict[str, str]:
        """Further inputs of a measurement: the true surface and what the sensor saw of it."""
        data = self.clouds.dataset(dataset)
        if not data.has_truth:
            return {}
        seen = "clean" if data.is_scanned_from_truth else "visible"
        points = self.clouds.true_points(dataset, cloud)
        return {"truth": self.clouds.scene_file(dataset, cloud), seen: points}

    def rows(self) -> dict[RowKind, list[str]]:
        """The tables that are made of result rows of their own, with the files of these rows."""
        parts: dict[RowKind, Any] = {
            "scan_errors": self.plan.scanned,
            "recovery": self.plan.recovered,
        }
        folder = self.plan.results
        return {
            name: [f"{folder}/{name}/{'/'.join(part)}.json" for part in rows]
            for name, rows in parts.items()
            if rows
        }

    @property
    def threads_environment(self) -> str:
        """What goes before the command of a timed job: the threads that libraries may use."""
        return thread_environment(self.timing.threads)

    def cores(self, cores: int | None) -> int:
        """Cores that a timed job takes of those of the run: all where it is to run alone.

        cores: of the run; None where a cluster's nodes, not this machine, run the jobs.
        """
        threads = self.timing.threads
        return max(threads, cores or 0) if self.timing.exclusive else threads

    @cache  # noqa: B019
    def memory_mb(self, codec: str) -> int:
        """Estimate of the memory of a cell's job in MB: of the codec and the pictures.

        For the largest clouds: a function for each of very many jobs would cost planning more.
        """
        datasets = self.plan.datasets.values()
        views = max((data.settings.views for data in datasets), default=0)
        points = max((data.points for data in datasets), default=0)
        changes = self.plan.config.codec(codec)
        pictures = views**2 * _BYTES_PER_PIXEL // 1_000_000
        return max(memory_mb(codec, points, changes), self._cloud_memory_mb) + pictures

    @cached_property
    def _cloud_memory_mb(self) -> int:
        return max(map(self.clouds.memory_mb, self.plan.datasets), default=0)

    @property
    def _timed(self) -> dict[str, Any]:
        return {"repeats": self.timing.repeats, "alone": self.timing.exclusive}

    def _entry(self, codec: str, rate: str) -> dict[str, Any]:
        """The codec's whole entry with that rate alone."""
        entry = self.plan.codecs[codec]
        return {**entry, "rates": {rate: entry["rates"][rate]}}

    def _module(self, codec: str) -> str:
        return module_of(self.plan.codecs[codec]["class"])

    @cache  # noqa: B019
    def _weights(self, codec: str) -> str:
        """Digests of a codec's weights, where it has any."""
        return " ".join(map(sha256, self.plan.weights[codec]))

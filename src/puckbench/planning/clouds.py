from __future__ import annotations

from collections.abc import Iterable
from functools import cache, cached_property
from pathlib import Path

from cloud_files import clouds
from cloud_files.content import plain_suffix
from cloud_files.meshes import reading as meshes
from puckbench.jobs.prepare import Prepare
from puckbench.jobs.prepare_returns import PrepareReturns
from puckbench.jobs.sample import Sample
from puckbench.jobs.scene import WriteScene
from puckbench.planning.plan import DataSetPlan, Plan
from puckbench.planning.planned_job import PlannedJob, planned
from puckbench.planning.scene_checks import scan_record
from puckbench.planning.sensing import Code, code_of_scan, files_of_scan
from puckbench.scene_sets import recordings
from puckbench.scene_sets.registry import LOADERS

_BYTES_PER_POINT = 1_000
"""Estimated memory of a job per point, bytes."""
_FOLDERS = {"sample": ("samples", "ply"), "scan": ("scans", "parquet")}


class CloudJobs:
    """Plans the jobs that write scenes, and make from them the clouds that codecs encode."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def dataset(self, name: str) -> DataSetPlan:
        """Return the planned clouds of a data set."""
        return self.plan.datasets[name]

    def scene_file(self, dataset: str, cloud: str, suffix: str = "") -> str:
        """Return the path of the scene's file from which a cloud is made.

        `suffix`, without a dot, replaces the suffix of the scene's format (``ply``, or ``parquet``
        for a sensor's returns).
        """
        data = self.dataset(dataset)
        scene, _ = data.source_of(cloud)
        suffix = suffix or ("parquet" if data.scene_set in self.of_returns else "ply")
        return f"{self.plan.results}/scenes/{data.scene_set}/{scene}.{suffix}"

    @cached_property
    def of_returns(self) -> list[str]:
        """Names of the scene sets whose scenes are a sensor's returns."""
        return [name for name, scenes in self.plan.scene_sets.items() if scenes.scenes.of_returns]

    def prepared(self, has_returns: bool) -> list[str]:
        """Return the names of the data sets whose clouds have, or lack, a sensor's returns."""
        sets = self.plan.datasets.items()
        return [name for name, data in sets if data.has_returns == has_returns]

    def source(self, dataset: str, cloud: str) -> str:
        """Return the path of the sample, scan or captured cloud that is prepared for coding."""
        make = self.dataset(dataset).settings.make
        if make == "cloud":
            return self.scene_file(dataset, cloud)
        folder, suffix = _FOLDERS[make]
        return f"{self.plan.results}/{folder}/{dataset}/{cloud}.{suffix}"

    def sources(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the files that the preparation of a cloud reads, by input name.

        ``source`` is the path from `source`; ``sampled``, for samples only, is its description.
        """
        source = self.source(dataset, cloud)
        if self.dataset(dataset).settings.make != "sample":
            return {"source": source}
        return {"source": source, "sampled": str(Path(source).with_suffix(".json"))}

    def is_cropped(self, dataset: str) -> bool:
        """Return whether a data set's clouds are scans, cropped to the bounding box of the room."""
        settings = self.dataset(dataset).settings
        return settings.is_scan and settings.crop != "none" and not settings.is_metric

    def true_points(self, dataset: str, cloud: str) -> str:
        """Return the path of the cloud with the true position of each of a cloud's points."""
        return f"{self.plan.results}/truth/{dataset}/{cloud}.ply"

    def scene(self, scenes: str, name: str) -> PlannedJob:
        """Plan the job that writes a scene of a scene set as a mesh or cloud."""
        scene_set = self.plan.scene_sets[scenes]
        is_generated = "seed" in type(scene_set.scenes).model_fields
        record = WriteScene(
            loader=scene_set.loader,
            name=name,
            options=scene_set.options_of(name),
            seed=scene_set.seed if is_generated else 0,
        )
        files = scene_set.files(name)
        modules = loader_modules(scene_set.loader, files)
        return planned(record, *modules, also=self.plan.digest_of(files))

    def sample(self, dataset: str, cloud: str) -> PlannedJob:
        """Plan the job that samples the points of a cloud on its scene's mesh."""
        data = self.dataset(dataset)
        _, seed = data.source_of(cloud)
        return planned(Sample(points=data.settings.points, seed=seed), also=data.scene_set)

    def scan(self, dataset: str, cloud: str) -> PlannedJob:
        """Plan the job that scans a scene's mesh with the virtual sensor.

        The job runs again if the sensor, the sweep or the error model changes.
        """
        data = self.dataset(dataset)
        modules, also = self._sensing(dataset)
        return planned(scan_record(data.settings, *data.source_of(cloud)), *modules, also=also)

    @cache  # noqa: B019 (one plan lives as long as the process)
    def _sensing(self, dataset: str) -> Code:
        settings = self.dataset(dataset).settings
        modules, also = code_of_scan(settings)
        files = self.plan.digest_of(files_of_scan(settings))
        return modules, f"{also} {settings.scene_set} {files}"

    def sensing_files(self, dataset: str) -> list[str]:
        """Return the user's files that define the sensor, its motion or its errors."""
        return files_of_scan(self.dataset(dataset).settings)

    def prepare(self, dataset: str) -> PlannedJob:
        """Plan the job that crops, scales and describes a cloud of a data set."""
        settings = self.dataset(dataset).settings
        source = f"{settings.make} {settings.scene_set}"
        if self.dataset(dataset).has_returns:
            model = settings.errors if settings.is_scan else ""
            returns = PrepareReturns(neighbours=settings.neighbours, error_model=model)
            return planned(returns, also=source)
        crop = settings.crop if self.is_cropped(dataset) else "none"
        size = 0 if settings.size == "metric" else settings.size
        record = Prepare(crop=crop, size=size, neighbours=settings.neighbours)
        return planned(record, also=source)

    def memory_mb(self, dataset: str) -> int:
        """Return the estimated memory (MB) of a job that makes a cloud of a data set."""
        return 400 + self.dataset(dataset).points * _BYTES_PER_POINT // 1_000_000


def loader_modules(loader: str, files: Iterable[str | Path]) -> list[str]:
    """Return the names of the modules with which a loader reads the files of a scene.

    They are the module of the loader, and the modules of the files' formats.
    """
    return [LOADERS.module_of(loader), *reader_modules(files)]


def reader_modules(files: Iterable[str | Path]) -> list[str]:
    """Return the names of the modules that read the formats of files.

    If the suffix of any file is unknown, the modules of all formats are returned.
    """
    readers = {**clouds.READERS, **meshes.READERS, **recordings.READERS}
    suffixes = {plain_suffix(Path(file)) for file in files} - {".ply", *recordings.CAPTURE_SUFFIXES}
    used = suffixes if suffixes <= readers.keys() else readers.keys()
    modules = {readers[suffix].partition(":")[0] for suffix in used}
    return sorted({name for module in modules for name in _PARTS.get(module, (module,))})


_PARTS = {
    "cloud_files.las": ("cloud_files.las", "cloud_files.las_header", "cloud_files.las_units"),
    "cloud_files.text": ("cloud_files.text", "cloud_files.text_numbers"),
    "puck.recording": ("puck.*",),
}
"""Modules that belong together, for readers whose code is in several modules."""

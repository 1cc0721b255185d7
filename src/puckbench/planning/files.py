from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

from puckbench.planning.plan import Plan

_BYTES_PER_POINT = 1_000
"""Estimated memory of a job per point, bytes."""
_FOLDERS = {"sample": ("samples", "ply"), "scan": ("scans", "parquet")}


class Files:
    """Paths of the results of a run.

    Methods that return several files return them by name of the input through which a rule reads
    them.

    Parameters
    ----------
    plan
        The plan of the run.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self._results = plan, str(plan.results)

    def scene(self, dataset: str, cloud: str, suffix: str = "") -> str:
        """Return the path of the scene's file from which a cloud is made.

        `suffix`, without a dot, replaces the suffix of the scene's format (``ply``, or ``parquet``
        for a sensor's returns).
        """
        data = self.plan.datasets[dataset]
        scene, _ = data.source_of(cloud)
        suffix = suffix or ("parquet" if data.scene_set in self.of_returns else "ply")
        return f"{self._results}/scenes/{data.scene_set}/{scene}.{suffix}"

    def scene_and_about(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the file of a cloud's scene, and its description as ``about``."""
        return {
            "scene": self.scene(dataset, cloud),
            "about": self.scene(dataset, cloud, "json"),
        }

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
        make = self.plan.datasets[dataset].settings.make
        if make == "cloud":
            return self.scene(dataset, cloud)
        folder, suffix = _FOLDERS[make]
        return f"{self._results}/{folder}/{dataset}/{cloud}.{suffix}"

    def sources(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the files that the preparation of a cloud reads.

        ``source`` is the path from `source`; ``about`` is the description of the scene; and
        ``sampled``, for samples only, is the description of the sample.
        """
        source = self.source(dataset, cloud)
        files = {"source": source, "about": self.scene(dataset, cloud, "json")}
        if self.plan.datasets[dataset].settings.make == "sample":
            files["sampled"] = str(Path(source).with_suffix(".json"))
        return files

    def true_points(self, dataset: str, cloud: str) -> str:
        """Return the path of the cloud with the true position of each of a cloud's points."""
        return f"{self._results}/truth/{dataset}/{cloud}.ply"

    def cloud(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the files of a prepared cloud and what lies beside it, as in `described`."""
        return self.described({"cloud": f"{self._results}/clouds/{dataset}/{cloud}.ply"})

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
        return frozenset(folder / name for name in self.prepared(has_returns=True))

    def truth(self, dataset: str, cloud: str) -> dict[str, str]:
        """Return the files with the truth about a cloud; empty without truth.

        ``truth`` is the true surface, in the scene's file. ``clean``, for a scan, or ``visible``,
        otherwise, is a cloud with the true position of each point.
        """
        data = self.plan.datasets[dataset]
        if not data.has_truth:
            return {}
        seen = "clean" if data.is_scanned_from_truth else "visible"
        points = {seen: self.true_points(dataset, cloud)}
        return {"truth": self.scene(dataset, cloud), **points} if data.has_true_surface else points

    def curve(self, dataset: str, cloud: str, codec: str) -> str:
        """Return the path of the archive with a cloud's streams at all rates of a codec."""
        return f"{self._results}/coded/{dataset}/{cloud}/{codec}.zip"

    def drive(self, drives: str, drive: str) -> str:
        """Return the path of the archive with the turns of a drive."""
        return f"{self._results}/drives/{drives}/{drive}.zip"

    def coded_drive(self, drives: str, drive: str, codec: str) -> str:
        """Return the path of the archive with a drive's streams at all rates of a codec."""
        return f"{self._results}/coded_drives/{drives}/{drive}/{codec}.zip"

    def memory_mb(self, dataset: str) -> int:
        """Return the estimated memory (MB) of a job that makes a cloud of a data set."""
        return 400 + self.plan.datasets[dataset].points * _BYTES_PER_POINT // 1_000_000

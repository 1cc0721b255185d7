"""Measuring a decoded cloud, or a stream that is decoded first: one result row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from puckbench import __version__
from puckbench.core.files import read_json, write_json
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import read_cloud
from puckbench.jobs.codecs import record_file
from puckbench.jobs.decode import Decoding
from puckbench.jobs.registry import JOBS
from puckbench.jobs.surfaces import read_truth
from puckbench.metrics.further import further_metrics
from puckbench.metrics.measures import measures, picture_measures, truth_measures

_KEPT = ("name", "group", "scale", "diameter", "elongation")
"""What a result row keeps of the reference's description."""


@JOBS.register("evaluate")
class Evaluate(Decoding):
    """Measure a decoded cloud or a stream against the cloud that was coded, and the truth.

    dataset: its name, for the row. peak: of the PSNRs; by default the cloud's own, and none where
    its description tells no size.
    views: pixels of six pictures to compare; 0 for none. metrics: further ones, by name.
    """

    dataset: str | None = None
    peak: float | None = None
    views: int = 0
    metrics: tuple[str, ...] = ()

    def run(
        self,
        cloud: Path,
        decoded: Path,
        row: Path | None = None,
        truth: Path | None = None,
        visible: Path | None = None,
        clean: Path | None = None,
    ) -> dict[str, Any]:
        """Write the result row and return it.

        Parameters
        ----------
        cloud
            The cloud that was coded.
        decoded
            A decoded cloud (.ply), or a stream.
        truth
            The true surface: a mesh or captured room in metres, or a cloud in the frame of `cloud`.
        visible
            Points of the true surface that the cloud's own stand for.
        clean
            The clean scan of the same rays, in place of `visible`.
        """
        reference = read_cloud(cloud)
        points, record = self._decoded(decoded)
        found = measures(reference, points.xyz, self.peak)
        result = {
            **({"dataset": self.dataset} if self.dataset else {}),
            **{key: reference.about[key] for key in _KEPT if key in reference.about},
            **record,
            "puckbench_version": __version__,
            **found,
            **picture_measures(reference, points, self.views, found),
            **_against_truth(reference, points, truth, visible, clean),
        }
        result |= further_metrics(self.metrics, reference, points, result)
        result["cloud"] = result.pop("name", cloud.stem)
        if row:
            write_json(row, result)
        return result

    def _decoded(self, path: Path) -> tuple[PointCloud, dict[str, Any]]:
        if path.suffix == ".ply":
            return read_cloud(path), {}
        points, record = self.decoded(path)
        beside = record_file(path)
        return PointCloud(points), {**(read_json(beside) if beside.exists() else {}), **record}


def _against_truth(
    reference: PointCloud,
    decoded: PointCloud,
    truth: Path | None,
    visible: Path | None,
    clean: Path | None,
) -> dict[str, float]:
    if truth is None and visible is None and clean is None:
        return {}
    surface = None if truth is None else read_truth(truth)
    seen, ideal = (None if path is None else read_cloud(path) for path in (visible, clean))
    return truth_measures(reference, decoded.xyz, surface, seen, ideal)

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, field_validator

from cloud_files.clouds import read_cloud
from pointkit.errors import naming
from pointkit.lidar.returns import with_returns
from pointkit.models import Model
from pointkit.terminal import Progress
from puckbench import __version__
from puckbench.core.code import CODEC, MESH_FILES
from puckbench.geometry.surfaces import read_truth
from puckbench.metrics.cloud_metrics import attribute_metrics, geometry_metrics, picture_metrics
from puckbench.metrics.metric_registry import METRICS, FurtherMetrics, Options
from puckbench.metrics.sensor_metrics import decoded_range_errors, real_time_metrics
from puckbench.results.columns import FRAME
from puckbench.results.curves import read_curve, with_remarks
from puckbench.results.row_files import write_rows
from puckbench.steps.coding import Decoded, TimedStep, decoded_cloud, planned_codec_step, ready
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from pointkit.geometry.cloud import PointCloud
    from pointkit.lidar.returns import Returns
    from puckbench.planning.workflow import Workflow

CODE = (
    *(*MESH_FILES, *CODEC, "puckbench.geometry.surfaces"),
    *("puckbench.metrics.cloud_metrics", "puckbench.metrics.remarks", "puckbench.metrics.truth"),
    "puckbench.geometry.sampling",
)

_KEPT = (
    *("name", "scene", "group", "scale", "diameter", "elongation"),
    *("dropped_points", "missing_returns", "file_bytes", "file_attributes"),
)
"""Entries of the original cloud's description that a row of results repeats."""


class Originals:
    """The original of decoded clouds: the encoded cloud and, if given, the true surface.

    The files are read when the object is made, and serve for all rates.

    Parameters
    ----------
    cloud
        File of the encoded cloud.
    truth
        File of the true surface: a mesh or captured room in metres, or a cloud in the coordinate
        frame of `cloud`.
    visible
        File of a cloud with the point of the true surface for each point of `cloud`.
    clean
        File of the scan along the same rays without the sensor's errors.
    """

    def __init__(
        self,
        cloud: Path,
        truth: Path | None = None,
        visible: Path | None = None,
        clean: Path | None = None,
    ) -> None:
        from puckbench.metrics.geometry import ReferenceCloud
        from puckbench.metrics.truth import Truth

        self.name, self._cloud = cloud.stem, cloud
        self._further: tuple[Mapping[str, Options], FurtherMetrics] | None = None
        self.reference = ReferenceCloud(read_cloud(cloud))
        self.truth = None
        if truth or visible or clean:
            surface = None if truth is None else read_truth(truth)
            seen, ideal = (None if path is None else read_cloud(path) for path in (visible, clean))
            self.truth = Truth(self.reference.cloud, surface, seen, ideal)

    @cached_property
    def returns(self) -> Returns | None:
        """The sensor's returns of the encoded cloud, or None."""
        return self.attributed.returns

    @cached_property
    def attributed(self) -> PointCloud:
        """The encoded cloud, with the sensor's returns if it has any."""
        return with_returns(self.reference.cloud, self._cloud)

    def further(self, metrics: Mapping[str, Options]) -> FurtherMetrics:
        """Return further metrics of decoded clouds.

        Parameters
        ----------
        metrics
            Options of each metric by name. What depends on the original alone is computed once, as
            long as these stay the same.
        """
        if self._further is None or self._further[0] != metrics:
            self._further = metrics, FurtherMetrics(metrics, self.attributed)
        return self._further[1]


class MeasuringSettings(Model):
    """How decoded clouds are measured."""

    peak: float | None = Field(
        None,
        gt=0,
        description="Peak of the PSNRs, in the unit of the clouds; by default `size - 1`, and 30 m "
        "with `size: metric` (MPEG uses 30,000 units of 1 mm; papers on KITTI use 59.7).",
    )
    views: int = Field(
        0,
        ge=0,
        description="Width in pixels of the six rendered views that are compared (PCC Arena: 1920; "
        "at least 11); 0: no views.",
    )

    @field_validator("views")
    @classmethod
    def _at_least_a_window(cls, views: int) -> int:
        if 0 < views < 11:
            raise ValueError(f"{views} pixels are too few: 0 for none, or at least 11")
        return views


class Measuring(MeasuringSettings):
    """How decoded clouds are measured, with the further metrics of a run.

    Parameters
    ----------
    dataset
        Name of the data set, for the row of results.
    metrics
        Options of further metrics, by name or place (``file.py:function``) of the metric.
    """

    dataset: str | None = None
    metrics: dict[str, dict[str, Any]] = Field({})

    def row(self, originals: Originals, decoded: Decoded) -> dict[str, Any]:
        """Return the row of results of one decoded cloud: values by name of the column."""
        from puckbench.metrics.geometry import DistinctPoints
        from puckbench.metrics.remarks import remark_on

        reference = originals.reference.cloud
        points, record = decoded
        returns = {}
        if originals.returns is not None:
            returns = decoded_range_errors(reference.xyz, originals.returns, points)
        ready = DistinctPoints(points.xyz)
        errors = geometry_metrics(originals.reference, ready, self.peak)
        if returns and errors["lossless"] and points.returns is None:
            returns |= {"range_rms_mm": 0.0, "range_max_mm": 0.0}
        remark = remark_on(originals.reference, ready, errors)
        result = {
            **({"dataset": self.dataset} if self.dataset else {}),
            **({FRAME: reference.frame} if reference.frame == "metric" else {}),
            **{key: reference.about[key] for key in _KEPT if key in reference.about},
            **with_remarks(record, remark),
            "puckbench_version": __version__,
            **errors,
            **picture_metrics(reference, points, self.views),
            **attribute_metrics(originals.attributed, points, errors),
            **(originals.truth.metrics(ready) if originals.truth else {}),
            **returns,
            **real_time_metrics(reference.about, record),
        }
        result |= originals.further(self.metrics).of(points, result)
        result["cloud"] = result.pop("name", originals.name)
        return result


@STEPS.register("evaluate")
class Evaluate(Measuring, TimedStep):
    """Decode a cloud's streams at all rates of a curve, and measure the decoded clouds."""

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str, codec: str) -> PlannedStep:
        plan, files = flow.plan, flow.files
        settings = plan.datasets[dataset].settings
        step = cls(
            dataset=dataset,
            codec=codec,
            entry=plan.coding_entry(dataset, codec, plan.curve_rates(dataset, cloud, codec)),
            peak=settings.peak,
            views=settings.views,
            metrics=plan.metrics_of(dataset),
            **plan.timing,
        )
        truth = files.truth(dataset, cloud)
        inputs = {**files.cloud(dataset, cloud), **files.described(truth)}
        further_mb = sum(METRICS.get(name).memory_mb for name in step.metrics)
        return planned_codec_step(
            flow,
            step,
            {**inputs, "curve": files.curve(dataset, cloud, codec)},
            *map(METRICS.module_of, step.metrics),
            also=" ".join((*truth, plan.digest_of(plan.files_of_metrics(dataset)))).strip(),
            memory_mb=flow.costs.memory_mb(codec) + flow.costs.views_mb + further_mb,
        )

    def plugins(self) -> Iterable[str | None]:
        return *super().plugins(), *self.metrics

    def run(
        self,
        cloud: Path,
        curve: Path,
        rows: Path,
        truth: Path | None = None,
        visible: Path | None = None,
        clean: Path | None = None,
    ) -> dict[str, Any]:
        """Write one row of results for each rate to the file `rows` (Parquet).

        `truth`, `visible` and `clean` are the files of `Originals`.
        """
        from puckbench.metrics.remarks import order_remarks

        originals = Originals(cloud, truth, visible, clean)
        codec, coded = ready(self.opened()), read_curve(curve)
        progress, results = Progress("rate"), []
        with naming(curve):
            for done, stream in enumerate(coded.values(), start=1):
                result = decoded_cloud(codec, stream, self, twice=done == 1)
                results.append(self.row(originals, result))
                progress(done, len(coded))
        remarks = order_remarks(results)
        write_rows(rows, [with_remarks(*each) for each in zip(results, remarks, strict=True)])
        return {"rates": len(coded)}

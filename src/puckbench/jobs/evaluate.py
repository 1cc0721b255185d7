from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from cloud_files.clouds import SUFFIXES, read_cloud
from cloud_files.content import plain_suffix
from pointkit.errors import naming
from pointkit.files import write_json
from pointkit.lidar.returns import with_returns
from pointkit.terminal import Progress
from puckbench import __version__
from puckbench.core.code import CODEC, MESH_FILES
from puckbench.jobs.curve_files import REMARK, read_coded, read_curve
from puckbench.jobs.decoding import Decoded, Decoding
from puckbench.jobs.registry import JOBS
from puckbench.jobs.surfaces import read_truth
from puckbench.metrics.cloud_metrics import attribute_metrics, geometry_metrics, picture_metrics
from puckbench.metrics.metric_registry import further_metrics
from puckbench.metrics.sensor_metrics import decoded_range_errors, real_time_metrics
from puckbench.results.columns import FRAME
from puckbench.results.row_files import write_rows

if TYPE_CHECKING:
    from pointkit.geometry.cloud import PointCloud
    from pointkit.lidar.returns import Returns

CODE = (
    *(*MESH_FILES, *CODEC, "puckbench.jobs.decoding", "puckbench.jobs.surfaces"),
    *("puckbench.metrics.cloud_metrics", "puckbench.metrics.truth", "puckbench.geometry.sampling"),
    "puckbench.results.row_files",
)

_FEW_POINTS = 0.01
"""Ratio of decoded to encoded points below which a row of results gets a remark."""
_KEPT = (
    *("name", "scene", "group", "scale", "diameter", "elongation"),
    *("dropped_points", "missing_returns", "file_bytes"),
)
"""Entries of the original cloud's description that a row of results repeats."""


def is_decoded(path: Path) -> bool:
    """Return whether a file is a decoded cloud, and not a stream, as its suffix tells."""
    return plain_suffix(path) in SUFFIXES and plain_suffix(path) != ".bin"


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


class Evaluating(Decoding):
    """Base class of jobs that compare decoded clouds with the encoded cloud and the true surface.

    Parameters
    ----------
    dataset
        Name of the data set, for the row of results.
    peak
        PSNR peak, in the unit of the encoded cloud; by default that of the cloud's description.
    views
        Width, in pixels, of six rendered views of each cloud that are compared; 0 for none.
    metrics
        Names of further metrics, or places (``file.py:function``) of the user's own.
    """

    dataset: str | None = None
    peak: float | None = Field(None, gt=0)
    views: int = 0
    metrics: tuple[str, ...] = ()

    def plugins(self) -> Iterable[str | None]:
        return *super().plugins(), *self.metrics

    def row(self, originals: Originals, decoded: Decoded) -> dict[str, Any]:
        """Return the row of results of one decoded cloud: values by name of the column."""
        from puckbench.metrics.geometry import DistinctPoints

        reference = originals.reference.cloud
        points, record = decoded
        returns = {}
        if originals.returns is not None:
            returns = decoded_range_errors(reference.xyz, originals.returns, points)
        ready = DistinctPoints(points.xyz)
        errors = geometry_metrics(originals.reference, ready, self.peak)
        if returns and errors["lossless"] and points.returns is None:
            returns |= {"range_rms_mm": 0.0, "range_max_mm": 0.0}
        result = {
            **({"dataset": self.dataset} if self.dataset else {}),
            **({FRAME: reference.frame} if reference.frame == "metric" else {}),
            **{key: reference.about[key] for key in _KEPT if key in reference.about},
            **record,
            "puckbench_version": __version__,
            **errors,
            **picture_metrics(reference, points, self.views),
            **attribute_metrics(originals.attributed, points, errors),
            **(originals.truth.metrics(ready) if originals.truth else {}),
            **returns,
            **real_time_metrics(reference.about, record),
        }
        result |= further_metrics(self.metrics, reference, points, result)
        if len(points) < _FEW_POINTS * len(reference):
            lost = f"{len(points):,} of {len(reference):,} points came back"
            result[REMARK] = "; ".join(filter(None, [result.get(REMARK), lost]))
        result["cloud"] = result.pop("name", originals.name)
        return result


@JOBS.register("evaluate")
class Evaluate(Evaluating):
    """Measure one decoded cloud, or one stream, which is decoded first.

    `rate` is the name of the rate to decode if the file is a curve with several rates.
    """

    rate: str | None = None

    def run(
        self, cloud: Path, decoded: Path, row: Path | None = None, **truth: Path | None
    ) -> dict[str, Any]:
        """Compare `decoded` with the encoded cloud `cloud`, and return the row of results.

        The row is written to the file `row` (JSON) if it is set. `truth` are the files ``truth``,
        ``visible`` and ``clean`` of `Originals`.
        """
        result = self.row(Originals(cloud, **truth), self._decoded(decoded))
        if row:
            write_json(row, result)
        return result

    def _decoded(self, path: Path) -> Decoded:
        if is_decoded(path):
            return Decoded(read_cloud(path), {})
        with naming(path):
            return self.decoded(read_coded(path, self.rate))


@JOBS.register("evaluate_curve")
class EvaluateCurve(Evaluating):
    """Decode a cloud's streams at all rates of a curve, and measure the decoded clouds."""

    def run(self, cloud: Path, curve: Path, rows: Path, **truth: Path | None) -> dict[str, Any]:
        """Write one row of results for each rate to the file `rows` (Parquet).

        `truth` are the files ``truth``, ``visible`` and ``clean`` of `Originals`.
        """
        originals = Originals(cloud, **truth)
        coded, progress = read_curve(curve), Progress("rate")
        results = []
        with naming(curve):
            for done, stream in enumerate(coded.values(), start=1):
                results.append(self.row(originals, self.decoded(stream, again=done == 1)))
                progress(done, len(coded))
        write_rows(rows, results)
        return {"rates": len(coded)}

"""Measuring decoded clouds, or streams that are decoded first: one result row each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from puckbench import __version__
from puckbench.core.content import plain_suffix
from puckbench.core.errors import InputError
from puckbench.core.files import write_json
from puckbench.core.progress import Progress
from puckbench.io.clouds import SUFFIXES, read_cloud
from puckbench.jobs.codecs import read_record, record_file
from puckbench.jobs.decode import Decoded, Decoding
from puckbench.jobs.registry import JOBS
from puckbench.jobs.surfaces import read_truth
from puckbench.lidar.returns import with_returns
from puckbench.metrics.frames import FRAME
from puckbench.metrics.further import further_metrics
from puckbench.metrics.measures import measures, picture_measures
from puckbench.metrics.returns import keeping_up, range_errors, range_errors_of_points

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns

_KEPT = (
    *("name", "group", "scale", "diameter", "elongation"),
    *("dropped_points", "missing_returns"),
)
"""What a result row keeps of the reference's description."""


class Originals:
    """What decoded clouds are measured against, read and made ready once.

    Parameters
    ----------
    cloud
        The cloud that was coded.
    truth
        The true surface: a mesh or captured room in metres, or a cloud in the frame of `cloud`.
    visible
        Points of the true surface that the cloud's own stand for.
    clean
        The clean scan of the same rays, in place of `visible`.
    """

    def __init__(
        self,
        cloud: Path,
        truth: Path | None = None,
        visible: Path | None = None,
        clean: Path | None = None,
    ) -> None:
        from puckbench.metrics.geometry import Reference
        from puckbench.metrics.truth import Truth

        self.name, self._cloud = cloud.stem, cloud
        self.reference = Reference(read_cloud(cloud))
        self.truth = None
        if truth or visible or clean:
            surface = None if truth is None else read_truth(truth)
            seen, ideal = (None if path is None else read_cloud(path) for path in (visible, clean))
            self.truth = Truth(self.reference.cloud, surface, seen, ideal)

    @cached_property
    def returns(self) -> Returns | None:
        """The returns that the cloud carries, if any."""
        return with_returns(self.reference.cloud, self._cloud).returns


class Evaluating(Decoding):
    """A job that measures against the cloud that was coded, and the truth.

    dataset: its name, for the row. peak: of the PSNRs; by default the cloud's own, and none where
    its description tells no size.
    views: pixels of six pictures to compare; 0 for none. metrics: further ones, by name.
    """

    dataset: str | None = None
    peak: float | None = Field(None, gt=0)
    views: int = 0
    metrics: tuple[str, ...] = ()

    def plugins(self) -> Iterable[str | None]:
        """The codec's, and the metrics."""
        return *super().plugins(), *self.metrics

    def row(self, originals: Originals, decoded: Path) -> dict[str, Any]:
        """The result row of a decoded cloud, or of a stream (.bin)."""
        return self._row_of(originals, self._found(decoded))

    def _row_of(self, originals: Originals, found: Decoded) -> dict[str, Any]:
        from puckbench.metrics.geometry import DistinctPoints

        reference = originals.reference.cloud
        points, record = found
        returns = {}
        if originals.returns is not None:
            returns = (
                range_errors_of_points(reference.xyz, points.xyz)
                if points.returns is None
                else range_errors(originals.returns, points.returns)
            )
        ready = DistinctPoints(points.xyz)
        errors = measures(originals.reference, ready, self.peak)
        if returns and errors["lossless"] and points.returns is None:
            returns |= {"range_rms_mm": 0.0, "range_max_mm": 0.0}
        result = {
            **({"dataset": self.dataset} if self.dataset else {}),
            **({FRAME: reference.frame} if reference.frame == "metric" else {}),
            **{key: reference.about[key] for key in _KEPT if key in reference.about},
            **record,
            "puckbench_version": __version__,
            **errors,
            **picture_measures(reference, points, self.views, errors),
            **(originals.truth.measures(ready) if originals.truth else {}),
            **returns,
            **keeping_up(reference.about, record),
        }
        result |= further_metrics(self.metrics, reference, points, result)
        result["cloud"] = result.pop("name", originals.name)
        return result

    def write_rows(
        self,
        originals: Originals,
        streams: Sequence[Path],
        rows: Sequence[Path],
        clouds: Sequence[Path] = (),
    ) -> dict[str, Any]:
        """Write the result row of each stream, and the decoded cloud of those that `clouds` name.

        Returns
        -------
        dict
            What was done, as `work` says it.
        """
        progress, seconds = Progress("rate"), 0.0
        written = {cloud.stem: cloud for cloud in clouds}
        for record in map(record_file, streams):
            if not record.exists():
                raise InputError(f"{record}: no such file: delete the streams beside it")
        for done, (stream, row) in enumerate(zip(streams, rows, strict=True), start=1):
            found = self._found(stream)
            if stream.stem in written:
                self.write_decoded(found, stream, written[stream.stem])
            write_json(row, self._row_of(originals, found))
            seconds += found.record["decode_s"]
            progress(done, len(rows))
        points = len(originals.reference.cloud)
        return {**self.work(points, len(rows), seconds), "truth": originals.truth is not None}

    def _found(self, path: Path) -> Decoded:
        """A decoded cloud as it is, or that of a stream with what it cost."""
        if plain_suffix(path) in SUFFIXES and plain_suffix(path) != ".bin":
            return Decoded(read_cloud(path), {})
        found = self.decoded(path)
        return Decoded(found.cloud, {**read_record(path), **found.record})


@JOBS.register("evaluate")
class Evaluate(Evaluating):
    """Measure a decoded cloud or a stream."""

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
        decoded
            A decoded cloud, or a stream (.bin, or of a suffix that no cloud has).
        cloud, truth, visible, clean
            As `Originals` takes them.
        """
        result = self.row(Originals(cloud, truth, visible, clean), decoded)
        if row:
            write_json(row, result)
        return result


@JOBS.register("evaluate_curve")
class EvaluateCurve(Evaluating):
    """Measure the streams of a rate-distortion curve, in one process."""

    def run(
        self,
        cloud: Path,
        streams: tuple[Path, ...],
        rows: tuple[Path, ...],
        clouds: tuple[Path, ...] = (),
        truth: Path | None = None,
        visible: Path | None = None,
        clean: Path | None = None,
    ) -> dict[str, Any]:
        """Write the result rows, one for each stream, and decoded clouds of some.

        Parameters
        ----------
        clouds
            Decoded clouds to write, each of the stream that has its name.
        cloud, truth, visible, clean
            As `Originals` takes them.
        """
        return self.write_rows(Originals(cloud, truth, visible, clean), streams, rows, clouds)

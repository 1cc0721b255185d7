"""Measuring the streams of a codec of surfaces, and the primitives that these are made of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from puckbench.core.files import write_json
from puckbench.jobs.evaluate import Evaluating, Originals
from puckbench.jobs.recovery import LabelledPoints, Recovering
from puckbench.jobs.registry import JOBS


@JOBS.register("evaluate_surfaces")
class EvaluateSurfaces(Evaluating, Recovering):
    """Measure the streams of a rate-distortion curve and their primitives, in one process."""

    def run(
        self,
        cloud: Path,
        streams: tuple[Path, ...],
        rows: tuple[Path, ...],
        recovered: tuple[Path, ...],
        points: Path,
        scene: Path,
        clouds: tuple[Path, ...] = (),
        truth: Path | None = None,
        visible: Path | None = None,
        clean: Path | None = None,
    ) -> dict[str, Any]:
        """Write the result rows, then those of the primitives, one of each for each stream.

        Parameters
        ----------
        cloud, truth, visible, clean
            As `puckbench.jobs.evaluate.Originals` takes them.
        clouds
            Decoded clouds to write, each of the stream that has its name.
        points, scene
            As `puckbench.jobs.recovery.LabelledPoints` takes them.
        """
        done = self.write_rows(Originals(cloud, truth, visible, clean), streams, rows, clouds)
        labelled = LabelledPoints(points, scene)
        for stream, row in zip(streams, recovered, strict=True):
            write_json(row, self.recovered(labelled, cloud.stem, stream))
        return done

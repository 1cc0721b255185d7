from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from puckbench.datasets.recordings import decompressed
from puckbench.jobs.registry import JOBS, Job


@JOBS.register("capture_residuals")
class CaptureResiduals(Job):
    """Find walls, floor and ceiling in a recording, and measure the range noise on them."""

    options: dict[str, Any] = Field({})

    def run(self, capture: Path, table: Path) -> dict[str, Any]:
        from puckbench.io.tables import write_table
        from puckbench.lidar.residual_table import REAL
        from puckbench.lidar.walls.residuals import (
            recorded_planes,
            recording_options,
            recording_residuals,
        )
        from puckbench.lidar.walls.statistics import recording_summary

        options = recording_options(self.options)
        with decompressed(capture) as recording:
            planes = recorded_planes(recording, options, source=capture)
        write_table(recording_residuals(planes), table)
        return {"model": REAL, **recording_summary(planes)}

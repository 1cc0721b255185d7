from __future__ import annotations

from pathlib import Path
from typing import Any

from puckbench.jobs.registry import JOBS
from puckbench.thesis.jobs.residuals import WallScanJob


@JOBS.register("wall_points")
class WallPoints(WallScanJob):
    distances: tuple[float, ...] = (1.0, 5.0)

    def run(self, table: Path) -> dict[str, Any]:
        from puckbench.io.tables import write_table
        from puckbench.thesis.residuals.virtual import Procedure
        from puckbench.thesis.residuals.wall_points import wall_points

        procedure = Procedure(self.model, self.model_options, keep=self.keep)
        points = wall_points(procedure, list(self.distances), self.seed)
        write_table(points, table)
        return {"model": self.model, "points": len(points)}

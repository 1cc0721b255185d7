from __future__ import annotations

from pathlib import Path
from typing import Any

from jenco2022.jobs.residuals import WallScanJob
from puckbench.jobs.registry import JOBS


@JOBS.register("wall_points")
class WallPoints(WallScanJob):
    distances: tuple[float, ...] = (1.0, 5.0)

    def run(self, table: Path) -> dict[str, Any]:
        from jenco2022.residuals.virtual import Procedure
        from jenco2022.residuals.wall_points import wall_points
        from pointkit.tables import write_table

        procedure = Procedure(self.model, self.model_options, keep=self.keep)
        points = wall_points(procedure, list(self.distances), self.seed)
        write_table(points, table)
        return {"model": self.model, "points": len(points)}

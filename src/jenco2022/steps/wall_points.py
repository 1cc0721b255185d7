from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from jenco2022.residuals.wall_scans import WallScans
from puckbench.core.code import SENSOR
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*SENSOR, "jenco2022.residuals", "virtual_lidar.scenes.*")


@STEPS.register("wall_points")
class WallPoints(WallScans):
    """Write the points of a virtual scan of a wall and a floor from each distance.

    `rows` is the largest number of points of a surface at one distance, chosen at random.
    """

    distances_m: tuple[float, ...] = (1.0, 5.0)
    rows: int = Field(40_000, ge=1)

    @classmethod
    def of_plan(cls, flow: Workflow, /, model: str) -> PlannedStep:
        shown = flow.sensor_study.study.shown_m
        return cls.planned_for(flow, model, minutes=10, distances_m=shown)

    def run(self, table: Path) -> dict[str, Any]:
        """Write the points to the file `table`, and return their number."""
        from jenco2022.residuals.virtual import Procedure, wall_points
        from pointkit.tables import write_table

        procedure = Procedure(self.errors, self.error_options, keep=self.rows)
        points = wall_points(procedure, list(self.distances_m), self.seed)
        write_table(points, table)
        return {"model": self.errors, "points": len(points)}

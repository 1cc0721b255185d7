from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from jenco2022.residuals.wall_scans import WallScans
from puckbench.core.code import SENSOR
from puckbench.steps.sensing import ResidualSettings
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*SENSOR, "jenco2022.residuals", "virtual_lidar.scenes.*")


@STEPS.register("residuals")
class Residuals(WallScans, ResidualSettings):
    """Measure how far the points of virtual scans lie from fitted planes."""

    @classmethod
    def of_plan(cls, flow: Workflow, /, model: str) -> PlannedStep:
        study = flow.sensor_study.study
        settings = {name: getattr(study.settings, name) for name in ResidualSettings.model_fields}
        distances = study.all_distances_m
        return cls.planned_for(flow, model, minutes=20, distances_m=distances, **settings)

    def run(self, table: Path) -> dict[str, Any]:
        """Write the residuals to the file `table`, and return their mean and deviation."""
        from jenco2022.residuals.virtual import Procedure, residual_table
        from pointkit.tables import write_table

        procedure = Procedure(self.errors, self.error_options, refit=self.refit, keep=self.rows)
        rows = residual_table(procedure, list(self.distances_m), self.runs, self.seed)
        write_table(rows, table)
        residuals = rows["residual_m"].astype("float64")
        return {
            "model": self.errors,
            "rows": len(rows),
            "mean_m": float(residuals.mean()),
            "std_m": float(residuals.std()),
        }

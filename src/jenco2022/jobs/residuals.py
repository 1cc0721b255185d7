from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import Field

from puckbench.core.code import SENSOR
from puckbench.jobs.registry import JOBS, Job

CODE = (*SENSOR, "jenco2022.residuals", "virtual_lidar.scenes.*")


class WallScanJob(Job):
    """Base class of jobs that scan a wall and a floor with a virtual sensor.

    Parameters
    ----------
    model, model_options
        Name of the error model, and changes to its parameters.
    distances
        Distances of the sensor from the wall, in m.
    seed
        Seed of all random numbers.
    keep
        Largest number of rows of a scan, chosen at random; None keeps all rows.
    """

    model: str = "vlp16"
    model_options: dict[str, Any] = Field({})
    distances: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0, 5.0)
    seed: int = Field(0, ge=0)
    keep: int | None = Field(None, ge=1)

    def plugins(self) -> Iterable[str | None]:
        return (self.model,)


@JOBS.register("residuals")
class Residuals(WallScanJob):
    """Measure how far the points of virtual scans lie from fitted planes.

    Parameters
    ----------
    runs
        Number of scans from each distance.
    refit
        Whether planes are fitted by least squares to the inliers of RANSAC.
    """

    runs: int = Field(3, ge=1)
    refit: bool = False

    def run(self, table: Path) -> dict[str, Any]:
        from jenco2022.residuals.virtual import Procedure, residual_table
        from pointkit.tables import write_table

        procedure = Procedure(self.model, self.model_options, refit=self.refit, keep=self.keep)
        rows = residual_table(procedure, list(self.distances), self.runs, self.seed)
        write_table(rows, table)
        residuals = rows["residual_m"].astype("float64")
        return {
            "model": self.model,
            "rows": len(rows),
            "mean_m": float(residuals.mean()),
            "std_m": float(residuals.std()),
        }


@JOBS.register("wall_points")
class WallPoints(WallScanJob):
    """Write the points of a virtual scan of a wall and a floor from each distance."""

    distances: tuple[float, ...] = (1.0, 5.0)

    def run(self, table: Path) -> dict[str, Any]:
        from jenco2022.residuals.virtual import Procedure, wall_points
        from pointkit.tables import write_table

        procedure = Procedure(self.model, self.model_options, keep=self.keep)
        points = wall_points(procedure, list(self.distances), self.seed)
        write_table(points, table)
        return {"model": self.model, "points": len(points)}

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from puckbench.jobs.gathered_tables import OfNames
from puckbench.jobs.registry import JOBS

CODE = (
    *("jenco2022.residuals", "pointkit.lidar.sensors", "puckbench.jobs.gathered_tables"),
    *("virtual_lidar.errors", "virtual_lidar.residual_table"),
    *("virtual_lidar.calibration.*", "virtual_lidar.errors.calibrated"),
)

COMPARED = ("hdl64e", "vlp16", "vlp16_divergence", "vlp16_measured")
"""Error models that are compared; the thesis chose `vlp16_divergence` (section 5.5.3)."""
_MAX_ROWS = 20_000
"""Largest number of rows of a recording; for each, every error model is simulated twenty times."""
_KEPT = ["model", "replicate", "capture", "distance_m", "run", "laser_id", "residual_m"]


@JOBS.register("joined_table")
class JoinedTable(OfNames):
    """Join tables of several error models into one.

    Parameters
    ----------
    kind
        Kind of the tables, which determines their columns.
    models
        Names of the tables' error models, for the column ``model``.
    """

    kind: Literal["residuals", "scans"]
    models: tuple[str, ...]

    def run(self, results: Path, parquet: Path) -> dict[str, Any]:
        from jenco2022.residuals.tables import joined_files
        from pointkit.tables import write_table

        table = joined_files(list(zip(self.models, self.files(results), strict=True)), self.kind)
        write_table(table, parquet)
        return {"rows": len(table)}


@JOBS.register("compared_residuals")
class ComparedResiduals(OfNames):
    """Simulate error models on the rays of recorded walls, and write all residuals."""

    def plugins(self) -> Iterable[str | None]:
        return COMPARED

    def run(self, results: Path, parquet: Path) -> dict[str, Any]:
        from jenco2022.residuals.tables import compared_residuals, real_walls, subsampled
        from pointkit.tables import write_table
        from virtual_lidar.errors import open_error_model
        from virtual_lidar.residual_table import read_residuals

        files = self.files(results)
        tables = [subsampled(read_residuals(path), _MAX_ROWS, str(path)) for path in files]
        models = {name: open_error_model(name) for name in map(str, self.plugins())}
        compared = compared_residuals(real_walls(tables), models)
        write_table(compared[_KEPT].astype({"residual_m": "float32"}), parquet)
        return {"rows": len(compared)}

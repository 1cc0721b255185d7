"""Parameters of a range error model from plane residuals."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from puckbench.jobs.registry import JOBS, Job


@JOBS.register("calibrate")
class Calibrate(Job):
    """Estimate a range error model from residual tables, one per device.

    model: whose rows count, where a table has several models. cells: what shares a bias, a frame or
    a spot; parameters: sigmas to estimate, all if not given. quantum_mm: steps of the ranges.
    """

    model: str | None = None
    cells: Literal["frame", "spot"] | None = None
    parameters: tuple[str, ...] | None = None
    quantum_mm: float | None = None

    def run(self, residuals: tuple[Path, ...], model: Path) -> dict[str, Any]:
        """Write the model file (YAML): estimates with their intervals."""
        from puckbench.lidar.calibration import calibrate, write_calibration
        from puckbench.lidar.calibration.files import read_tables, settings_for

        tables, name = read_tables(list(residuals), self.model)
        wanted = None if self.parameters is None else list(self.parameters)
        settings = settings_for(name, self.cells, wanted, self.quantum_mm)
        content = write_calibration(model, calibrate(tables, settings), list(residuals))
        return {"model": name, **content["provenance"]["counts"], **content}

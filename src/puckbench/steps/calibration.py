from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pointkit.errors import InputError
from puckbench.steps.step import STEPS, Paths, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (
    *("virtual_lidar.calibration.*", "virtual_lidar.errors", "virtual_lidar.errors.calibrated"),
    "virtual_lidar.residual_table",
)


@STEPS.register("calibration")
class Calibrate(Step):
    """Fit the parameters of an error model to the residuals of a real sensor's recordings.

    Parameters
    ----------
    model
        Name of the error model, or ``real``, whose rows of the tables of residuals are used; None
        if the tables have only one.
    cells
        Which returns of a laser share a bias: those in one ``frame``, or those at one ``spot`` for
        a sensor at rest. By default, spots for recordings, and otherwise frames.
    parameters
        Names of the standard deviations to estimate; by default all.
    quantum_mm
        Resolution of the ranges in mm; by default 2 for recordings, and otherwise 0.
    """

    model: str | None = None
    cells: Literal["frame", "spot"] | None = None
    parameters: tuple[str, ...] | None = None
    quantum_mm: float | None = None

    @classmethod
    def of_plan(cls, flow: Workflow, /) -> PlannedStep:
        names = flow.sensor_study.capture_files
        files = [f"{flow.plan.results}/{name}" for name in names]
        return planned(cls(), {"residuals": files}, also=names, memory_mb=2000, minutes=20)

    def run(self, model: Path, residuals: Paths = ()) -> dict[str, Any]:
        """Write the fitted model to the file `model` (YAML), and return its content.

        `residuals` are tables of the distances of measured points from fitted planes, one for each
        device.
        """
        from virtual_lidar import calibrate, write_calibration
        from virtual_lidar.calibration.files import read_tables, settings_for

        if not residuals:
            raise InputError("no recording to calibrate to (sensor_study: captures)")
        tables, name = read_tables(list(residuals), self.model)
        parameters = None if self.parameters is None else list(self.parameters)
        settings = settings_for(name, self.cells, parameters, self.quantum_mm)
        content = write_calibration(model, calibrate(tables, settings), list(residuals))
        return {"model": name, **content["provenance"]["counts"], **content}

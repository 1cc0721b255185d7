from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from puckbench.steps.results_table import JoiningStep
from puckbench.steps.sensing import code_of_models
from puckbench.steps.step import STEPS, PlannedStep, planned
from virtual_lidar import open_error_model
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.planning.workflow import Workflow

CODE = (
    *("jenco2022.residuals", "pointkit.lidar.sensors", "puckbench.steps.results_table"),
    *("virtual_lidar.errors", "virtual_lidar.residual_table"),
    *("virtual_lidar.calibration.*", "virtual_lidar.errors.calibrated"),
)

COMPARED_RESIDUALS = "compared_residuals"
COMPARED = ("hdl64e", "vlp16", "vlp16_divergence", "vlp16_measured")
"""Error models that are compared; the thesis chose `vlp16_divergence` (section 5.5.3)."""
_MAX_ROWS = 20_000
"""Largest number of rows of a recording; for each, every error model is simulated twenty times."""
_KEPT = ["model", "replicate", "capture", "distance_m", "run", "laser_id", "residual_m"]


@STEPS.register("study_table")
class StudyTable(JoiningStep):
    """Join tables of several error models or recordings, or compare error models with recordings.

    Parameters
    ----------
    table
        What is made: ``residuals`` and ``scans`` are joined tables of these kinds.
        ``compared_residuals`` has the residuals of recorded walls, and those of error models that
        are simulated on the same rays.
    models
        For joined tables, the names of the files' error models, for the column ``model``.
    """

    table: Literal["residuals", "scans", "compared_residuals"]
    models: tuple[str, ...] = ()

    @classmethod
    def of_plan(cls, flow: Workflow, /, table: str) -> PlannedStep:
        study = flow.sensor_study
        names = study.gathered[table]
        is_compared = table == COMPARED_RESIDUALS
        captures = [REAL] * len(study.capture_files) if table == "residuals" else []
        models = () if is_compared else (*study.study.models, *captures)
        step = cls.create(table=table, names=names, models=models)
        modules, also = code_of_models(map(open_error_model, COMPARED if is_compared else ()))
        inputs = {"rows": [f"{flow.plan.results}/{name}" for name in names]}
        return planned(step, inputs, *modules, also=also, memory_mb=3000, minutes=20)

    def plugins(self) -> Iterable[str | None]:
        return COMPARED if self.table == COMPARED_RESIDUALS else ()

    def run(self, results: Path, parquet: Path) -> dict[str, Any]:
        """Write the table to `parquet`, and return the number of rows.

        `results` is the results folder, in which the files `names` are.
        """
        from pointkit.tables import write_table

        table = self._made(self.files(results))
        write_table(table, parquet)
        return {"rows": len(table)}

    def _made(self, files: list[Path]) -> pd.DataFrame:
        from jenco2022.residuals import tables

        if self.table != COMPARED_RESIDUALS:
            return tables.joined_files(list(zip(self.models, files, strict=True)), self.table)
        from virtual_lidar.residual_table import read_residuals

        parts = [tables.subsampled(read_residuals(path), _MAX_ROWS, str(path)) for path in files]
        models = {name: open_error_model(name) for name in COMPARED}
        compared = tables.compared_residuals(tables.real_walls(parts), models)
        return compared[_KEPT].astype({"residual_m": "float32"})

"""The sensor study of chapter 5, whose jobs scan a wall and a floor with each error model."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from jenco2022.jobs.joined_tables import ComparedResiduals, JoinedTable
from jenco2022.jobs.residuals import Residuals, WallPoints, WallScanJob
from pointkit.lidar.sensors import load_sensor
from puckbench.planning.planned_job import Gathering, PlannedJob, planned
from puckbench.planning.sensing import code_of_models
from puckbench.planning.study import STUDIES, StudyJobs
from virtual_lidar import open_error_model
from virtual_lidar.residual_table import REAL

WALL_POINTS = 40_000
"""Number of points of a surface at one distance in figures of scans."""
_OF_CAPTURES = {
    "compared_residuals": "compared_residuals",
    "compared": "compared_residuals",
    "model_distances": "model_distances",
}
"""Tables that compare error models with captures, by the name of a figure's input."""


@STUDIES.register("sensor_study")
class ResidualStudy(StudyJobs):
    """The jobs of the sensor study, which a run plans from its configuration."""

    input_names = ("residuals", "scans", *_OF_CAPTURES)

    def residuals(self, model: str) -> PlannedJob:
        """Return the job that measures the plane residuals of an error model."""
        settings = self.study.settings
        return self._scan(
            Residuals,
            model,
            distances=self.study.all_distances_m,
            runs=settings.runs,
            keep=settings.rows,
            refit=settings.refit,
        )

    def wall_points(self, model: str) -> PlannedJob:
        """Return the job that writes points of scans with an error model."""
        return self._scan(WallPoints, model, distances=self.study.shown_m, keep=WALL_POINTS)

    @cached_property
    def gathered(self) -> dict[str, Gathering]:
        """Jobs that join the files of all error models to tables, by name of the table."""
        models, captures = tuple(self.study.models), self.capture_files()
        residuals = (*(f"residuals/models/{model}.parquet" for model in models), *captures)
        points = tuple(f"wall_points/{model}.parquet" for model in models)
        names = (*models, *[REAL] * len(captures))
        tables = {
            "residuals": _joined(residuals, kind="residuals", models=names),
            "scans": _joined(points, kind="scans", models=models),
        }
        if captures:
            tables["compared_residuals"] = _compared(captures)
        return tables

    @property
    def inputs(self) -> dict[str, str]:
        """Names of the study's tables, by the name of the input that they supply."""
        names = ["residuals", *(["scans"] if self.study.shown_m else [])]
        can_compare = not self.plan.has_failed("tables", "compared_residuals")
        of_captures = _OF_CAPTURES if self.study.captures and can_compare else {}
        return {name: name for name in names} | of_captures

    def _scan(self, job: type[WallScanJob], model: str, **settings: Any) -> PlannedJob:
        errors, options = self.study.models[model]
        modules, parameters = code_of_models([open_error_model(errors, options)])
        record = job.create(model=errors, model_options=options, seed=self.study.seed, **settings)
        files = self.plan.digest_of(self.model_files(model))
        return planned(record, *modules, also=f"{parameters} {load_sensor('vlp16')} {files}")


def _joined(files: tuple[str, ...], **settings: Any) -> Gathering:
    return Gathering(planned(JoinedTable.create(names=files, **settings)), files)


def _compared(captures: tuple[str, ...]) -> Gathering:
    job = ComparedResiduals.create(names=captures)
    modules, parameters = code_of_models(map(open_error_model, filter(None, job.plugins())))
    return Gathering(planned(job, *modules, also=parameters), captures)

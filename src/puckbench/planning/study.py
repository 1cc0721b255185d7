"""Jobs of the sensor study: residuals and points of walls and floors (thesis chapter 5)."""

from __future__ import annotations

from functools import cache
from typing import Any

from puckbench.jobs.calibrate import Calibrate
from puckbench.jobs.capture_residuals import CaptureResiduals
from puckbench.jobs.joined import AllModels, ComparedResiduals
from puckbench.jobs.registry import Job
from puckbench.jobs.residuals import Residuals
from puckbench.jobs.wall_points import WallPoints
from puckbench.lidar import load_sensor, open_error_model
from puckbench.lidar.errors import module_of_model
from puckbench.lidar.residual_table import REAL
from puckbench.planning.plan import Plan, StudyPlan
from puckbench.planning.planned_job import JoinedTable, PlannedJob, planned

WALL_POINTS = 40_000
"""Points of a surface at a distance that the study's figures of scans are drawn from."""


class StudyJobs:
    """Files and jobs of the sensor study; only rules of a configuration that has one ask."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    @property
    def study(self) -> StudyPlan:
        """The plan of the study."""
        assert self.plan.study is not None  # noqa: S101
        return self.plan.study

    @cache  # noqa: B019 (one plan lives as long as the process)
    def residuals(self, model: str) -> PlannedJob:
        """Measure plane residuals with an error model."""
        study = self.study
        record = Residuals(
            distances=study.all_distances_m,
            runs=study.runs,
            keep=study.rows,
            refit=study.refit,
            **self._model(model),
        )
        return planned(record, *self._modules(model), also=self._also(model))

    @cache  # noqa: B019
    def wall_points(self, model: str) -> PlannedJob:
        """Keep points of scans with an error model."""
        record = WallPoints(distances=self.study.shown_m, keep=WALL_POINTS, **self._model(model))
        return planned(record, *self._modules(model), also=self._also(model))

    @cache  # noqa: B019
    def capture_residuals(self, capture: str) -> PlannedJob:
        """Measure plane residuals of a recording."""
        return planned(CaptureResiduals(options=self.study.captures[capture][1]))

    def residual_files(self) -> list[tuple[str, str]]:
        """Name and residual table of every model and recording; all recordings have one name."""
        folder = f"{self.plan.results}/residuals/models"
        models = [(name, f"{folder}/{name}.parquet") for name in self.study.models]
        return models + [(REAL, file) for file in self.capture_files()]

    def capture_files(self) -> list[str]:
        """Residual tables of the study's recordings."""
        folder = f"{self.plan.results}/residuals/captures"
        return [f"{folder}/{name}.parquet" for name in self.study.captures]

    def calibrate(self) -> PlannedJob:
        """Estimate an error model from the recordings."""
        return planned(Calibrate())

    def joined_tables(self) -> dict[str, JoinedTable]:
        """The tables of all models and recordings in one."""
        names, files = zip(*self.residual_files(), strict=True)
        points = [f"{self.plan.results}/wall_points/{model}.parquet" for model in self.study.models]
        jobs: dict[str, tuple[Job, list[str]]] = {
            "residuals": (AllModels(kind="residuals", names=names), list(files)),
            "scans": (AllModels(kind="scans", names=tuple(self.study.models)), points),
        }
        if self.study.captures:
            jobs["compared_residuals"] = (ComparedResiduals(), self.capture_files())
        return {
            name: JoinedTable(planned(job), rows, {"parquet": self._table(name)})
            for name, (job, rows) in jobs.items()
        }

    def _table(self, name: str) -> str:
        return f"{self.plan.results}/tables/{name}.parquet"

    def _model(self, model: str) -> dict[str, Any]:
        errors, options = self.study.models[model]
        return {"model": errors, "model_options": options, "seed": self.study.seed}

    def _modules(self, model: str) -> tuple[str, ...]:
        return (module_of_model(open_error_model(*self.study.models[model])),)

    def _also(self, model: str) -> str:
        return f"{open_error_model(*self.study.models[model])} {load_sensor('vlp16')}"

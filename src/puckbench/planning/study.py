"""Jobs of the sensor study: residuals and points of walls and floors (thesis chapter 5)."""

from __future__ import annotations

from functools import cache, cached_property
from typing import Any

from puckbench.jobs.calibrate import Calibrate
from puckbench.jobs.capture_residuals import CaptureResiduals
from puckbench.jobs.joined import AllModels, ComparedResiduals, OfNames
from puckbench.jobs.residuals import Residuals
from puckbench.jobs.wall_points import WallPoints
from puckbench.lidar import load_sensor, open_error_model
from puckbench.lidar.errors import module_of_model
from puckbench.lidar.residual_table import REAL
from puckbench.planning.plan import Plan, StudyPlan
from puckbench.planning.planned_job import Gathering, PlannedJob, planned

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

    def capture_files(self) -> tuple[str, ...]:
        """Residual tables of the study's recordings, below the results folder."""
        return tuple(f"residuals/captures/{name}.parquet" for name in self.study.captures)

    def calibrate(self) -> PlannedJob:
        """Estimate an error model from the recordings."""
        return planned(Calibrate())

    @cached_property
    def gathered(self) -> dict[str, Gathering]:
        """The tables of all models and recordings in one; all recordings are one model."""
        models, captures = tuple(self.study.models), self.capture_files()
        files = (*(f"residuals/models/{model}.parquet" for model in models), *captures)
        points = tuple(f"wall_points/{model}.parquet" for model in models)
        names = (*models, *[REAL] * len(captures))
        jobs: dict[str, OfNames] = {
            "residuals": AllModels(kind="residuals", models=names, names=files),
            "scans": AllModels(kind="scans", models=models, names=points),
        }
        if captures:
            jobs["compared_residuals"] = ComparedResiduals(names=captures)
        return {name: Gathering(planned(job), job.names) for name, job in jobs.items()}

    def _model(self, model: str) -> dict[str, Any]:
        errors, options = self.study.models[model]
        return {"model": errors, "model_options": options, "seed": self.study.seed}

    def _modules(self, model: str) -> tuple[str, ...]:
        return (module_of_model(open_error_model(*self.study.models[model])),)

    def _also(self, model: str) -> str:
        return f"{open_error_model(*self.study.models[model])} {load_sensor('vlp16')}"

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

from pointkit.lidar.sensors import load_sensor
from puckbench.datasets.recordings import recording_files
from puckbench.jobs.calibrate import Calibrate
from puckbench.jobs.capture_residuals import CaptureResiduals
from puckbench.jobs.registry import JOBS, Job
from puckbench.planning.clouds import reader_modules
from puckbench.planning.plan import Plan, StudyPlan
from puckbench.planning.planned_job import Gathering, PlannedJob, planned
from puckbench.planning.sensing import code_of_models, files_named
from virtual_lidar import open_error_model
from virtual_lidar.residual_table import REAL

WALL_POINTS = 40_000
"""Number of points per surface and distance in figures of scans."""


class StudyJobs:
    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    @property
    def study(self) -> StudyPlan:
        assert self.plan.study is not None  # noqa: S101
        return self.plan.study

    def residuals(self, model: str) -> PlannedJob:
        study = self.study
        return self._scan(
            "residuals",
            model,
            distances=study.all_distances_m,
            runs=study.settings.runs,
            keep=study.settings.rows,
            refit=study.settings.refit,
        )

    def wall_points(self, model: str) -> PlannedJob:
        return self._scan("wall_points", model, distances=self.study.shown_m, keep=WALL_POINTS)

    def capture_residuals(self, capture: str) -> PlannedJob:
        record = CaptureResiduals(options=self.study.captures[capture][1])
        files = [file for inputs in self.recording(capture).values() for file in inputs]
        modules = reader_modules(self.recording(capture)["capture"])
        return planned(record, *modules, also=self.plan.digest_of(files))

    def recording(self, capture: str) -> dict[str, list[str]]:
        """Return the input files of a job that reads a capture, as paths by input name.

        ``capture`` is the recording itself; ``beside`` are the files that its reader needs besides,
        such as the sensor's description.
        """
        path, *beside = map(str, recording_files(Path(self.study.captures[capture][0])))
        return {"capture": [path], "beside": beside}

    def capture_files(self) -> tuple[str, ...]:
        return tuple(f"residuals/captures/{name}.parquet" for name in self.study.captures)

    def calibrate(self) -> PlannedJob:
        return planned(Calibrate(), also=self.capture_files())

    @cached_property
    def gathered(self) -> dict[str, Gathering]:
        models, captures = tuple(self.study.models), self.capture_files()
        residuals = (*(f"residuals/models/{model}.parquet" for model in models), *captures)
        points = tuple(f"wall_points/{model}.parquet" for model in models)
        names = (*models, *[REAL] * len(captures))
        tables = {
            "residuals": _joined("joined_table", residuals, kind="residuals", models=names),
            "scans": _joined("joined_table", points, kind="scans", models=models),
        }
        if captures:
            tables["compared_residuals"] = self._compared(captures)
        return tables

    def _compared(self, captures: tuple[str, ...]) -> Gathering:
        job = _job("compared_residuals", names=captures)
        modules, parameters = code_of_models(map(open_error_model, filter(None, job.plugins())))
        return Gathering(planned(job, *modules, also=parameters), captures)

    def _scan(self, job: str, model: str, **settings: Any) -> PlannedJob:
        errors, options = self.study.models[model]
        modules, parameters = code_of_models([open_error_model(errors, options)])
        record = _job(job, model=errors, model_options=options, seed=self.study.seed, **settings)
        files = self.plan.digest_of(self.model_files(model))
        return planned(record, *modules, also=f"{parameters} {load_sensor('vlp16')} {files}")

    def model_files(self, model: str) -> list[str]:
        return files_named(self.study.models[model][1].values())


def _job(name: str, **settings: Any) -> Job:
    return JOBS.get(name).create(**settings)


def _joined(job: str, files: tuple[str, ...], **settings: Any) -> Gathering:
    return Gathering(planned(_job(job, names=files, **settings)), files)

"""Jobs of the sensor study, of which another package has those that scan and compare.

A package that measures errors of sensors registers one class, in its module ``study``::

    @STUDIES.register("sensor_study")
    class MyStudy(StudyJobs): ...
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from pointkit.errors import InputError
from pointkit.registry import Registry
from puckbench.datasets.recordings import recording_files
from puckbench.jobs.calibrate import Calibrate
from puckbench.jobs.capture_residuals import CaptureResiduals
from puckbench.planning.clouds import reader_modules
from puckbench.planning.plan import Plan, StudyPlan
from puckbench.planning.planned_job import Gathering, PlannedJob, planned
from puckbench.planning.sensing import files_named


class StudyJobs(ABC):
    """Plans the jobs in ``workflow/rules/sensor.smk`` for a plan with a sensor study.

    Parameters
    ----------
    plan
        The plan.
    study
        The plan's sensor study: the checked settings, error models and captures.
    """

    input_names: ClassVar[tuple[str, ...]]
    """Names of all inputs that a study of this class can have (`inputs`)."""

    def __init__(self, plan: Plan, study: StudyPlan) -> None:
        self.plan, self.study = plan, study

    @abstractmethod
    def residuals(self, model: str) -> PlannedJob:
        """Plan the job that measures the plane residuals of an error model."""

    @abstractmethod
    def wall_points(self, model: str) -> PlannedJob:
        """Plan the job that makes the points of an error model for figures of scans."""

    @property
    @abstractmethod
    def gathered(self) -> Mapping[str, Gathering]:
        """Jobs that join files of several error models or captures, by name of their table."""

    @property
    @abstractmethod
    def inputs(self) -> Mapping[str, str]:
        """Tables of this study, by the names of parameters of tables and figures that read them."""

    def capture_residuals(self, capture: str) -> PlannedJob:
        """Plan the job that measures the plane residuals of a recording, given by its name."""
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
        """Return the files of the recordings' residuals, relative to the results folder."""
        return tuple(f"residuals/captures/{name}.parquet" for name in self.study.captures)

    def calibrate(self) -> PlannedJob:
        """Plan the job that fits an error model to the recordings' residuals."""
        return planned(Calibrate(), also=self.capture_files())

    def model_files(self, model: str) -> list[str]:
        """Return the paths of the files that the options of an error model name."""
        return files_named(self.study.models[model][1].values())


STUDIES: Registry[type[StudyJobs]] = Registry("study", "study")


def study_jobs(plan: Plan) -> StudyJobs | None:
    """Return the jobs of a plan's sensor study, or None if it has no study.

    Raises InputError if no installed package has the jobs.
    """
    if plan.study is None:
        return None
    if "sensor_study" not in STUDIES:
        fault = "no installed package measures it: install one, or set it to false"
        raise InputError(f"sensor_study: {fault}")
    return STUDIES.get("sensor_study")(plan, plan.study)

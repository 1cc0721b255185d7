"""Jobs of the sensor study, which measures the errors of sensor models and of real sensors.

The jobs that scan walls and compare error models are in another package, such as a plug-in of
puckbench. It registers one class, in its module ``study``::

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
from puckbench.jobs.calibrate import Calibrate
from puckbench.jobs.capture_residuals import CaptureResiduals
from puckbench.planning.clouds import reader_modules
from puckbench.planning.plan import Plan, StudyPlan
from puckbench.planning.planned_job import Gathering, PlannedJob, planned
from puckbench.planning.sensing import files_named
from puckbench.scene_sets.recordings import recording_files


class StudyJobs(ABC):
    """Base class that plans the jobs of a sensor study, which ``sensor.smk`` then runs.

    Parameters
    ----------
    plan
        The plan of the run.
    study
        The sensor study of this plan: checked settings, error models and recordings.
    """

    input_names: ClassVar[tuple[str, ...]]
    """All names that can be keys of `inputs`."""

    def __init__(self, plan: Plan, study: StudyPlan) -> None:
        self.plan, self.study = plan, study

    @abstractmethod
    def residuals(self, model: str) -> PlannedJob:
        """Plan the job that measures the distances of scanned points from the wall and floor.

        `model` is the name of an error model in the study.
        """

    @abstractmethod
    def wall_points(self, model: str) -> PlannedJob:
        """Plan the job that scans walls with an error model, for the figures that show scans."""

    @property
    @abstractmethod
    def gathered(self) -> Mapping[str, Gathering]:
        """Jobs that join the files of several error models or recordings, by name of the table."""

    @property
    @abstractmethod
    def inputs(self) -> Mapping[str, str]:
        """Names of this study's tables, by the parameter through which functions read them.

        The functions are those of registered tables and figures.
        """

    def capture_residuals(self, capture: str) -> PlannedJob:
        """Plan the job that measures the distances of recorded points from fitted planes.

        `capture` is the name of a recording in the study.
        """
        record = CaptureResiduals(options=self.study.captures[capture][1])
        files = [file for inputs in self.recording(capture).values() for file in inputs]
        modules = reader_modules(self.recording(capture)["capture"])
        return planned(record, *modules, also=self.plan.digest_of(files))

    def recording(self, capture: str) -> dict[str, list[str]]:
        """Return the paths of the files that make up a recording.

        The key ``capture`` has the recording itself. The key ``beside`` has the other files that
        the reader needs, such as the description of the sensor.
        """
        path, *beside = map(str, recording_files(Path(self.study.captures[capture][0])))
        return {"capture": [path], "beside": beside}

    def capture_files(self) -> tuple[str, ...]:
        """Return the files with residuals of all recordings, relative to the results folder."""
        return tuple(f"residuals/captures/{name}.parquet" for name in self.study.captures)

    def calibrate(self) -> PlannedJob:
        """Plan the job that fits the parameters of an error model to the recordings' residuals."""
        return planned(Calibrate(), also=self.capture_files())

    def model_files(self, model: str) -> list[str]:
        """Return the paths of those files that an error model reads, as named in its options."""
        return files_named(self.study.models[model][1].values())


STUDIES: Registry[type[StudyJobs]] = Registry("study", "study")


def study_jobs(plan: Plan) -> StudyJobs | None:
    """Return the object that plans the jobs of a sensor study, or None if `plan` has no study.

    Raises
    ------
    InputError
        The plan has a study, but no installed package provides its jobs.
    """
    if plan.study is None:
        return None
    if "sensor_study" not in STUDIES:
        fault = "no installed package measures it: install one, or set it to false"
        raise InputError(f"sensor_study: {fault}")
    return STUDIES.get("sensor_study")(plan, plan.study)

"""The sensor study, which measures the errors of sensor models and of real sensors.

Another package, such as a plug-in of puckbench, has the steps ``residuals``, ``wall_points`` and
``study_table``. It registers one class, in its module ``study``, which tells the study's tables::

    @STUDIES.register("sensor_study")
    class MyStudy(Study): ...
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from pointkit.errors import InputError
from pointkit.registry import Registry
from puckbench.planning.plan import Plan, StudyPlan
from puckbench.steps.sensing import files_named


class Study(ABC):
    """Base class of a sensor study, whose tables ``sensor.smk`` makes.

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

    @property
    @abstractmethod
    def gathered(self) -> Mapping[str, tuple[str, ...]]:
        """Files, relative to the results folder, that are joined to a table, by its name."""

    @property
    @abstractmethod
    def inputs(self) -> Mapping[str, str]:
        """Names of this study's tables, by the parameter through which functions read them.

        The functions are those of registered tables and figures.
        """

    @property
    def capture_files(self) -> tuple[str, ...]:
        """The files with residuals of all recordings, relative to the results folder."""
        return tuple(f"residuals/captures/{name}.parquet" for name in self.study.captures)

    def model_files(self, model: str) -> list[str]:
        """Return the paths of those files that an error model reads, as named in its options."""
        return files_named(self.study.models[model][1].values())


STUDIES: Registry[type[Study]] = Registry("study", "study")


def study_of(plan: Plan) -> Study | None:
    """Return the sensor study of a plan, or None if the plan has none.

    Raises
    ------
    InputError
        The plan has a study, but no installed package provides its steps.
    """
    if plan.study is None:
        return None
    if "sensor_study" not in STUDIES:
        fault = "no installed package measures it: install one, or set it to false"
        raise InputError(f"sensor_study: {fault}")
    return STUDIES.get("sensor_study")(plan, plan.study)

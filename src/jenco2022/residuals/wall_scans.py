"""What the steps share that scan a wall and a floor with an error model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from pydantic import Field

from pointkit.lidar.sensors import load_sensor
from puckbench.steps.sensing import code_of_models
from puckbench.steps.step import PlannedStep, Step, planned
from virtual_lidar import open_error_model

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow


class WallScans(Step):
    """Base class of steps that scan a wall and a floor with a virtual sensor.

    Parameters
    ----------
    errors, error_options
        Name of the error model, and changes to its parameters.
    distances_m
        Distances of the sensor from the wall, in m.
    seed
        Seed of all random numbers.
    """

    errors: str = "vlp16"
    error_options: dict[str, Any] = Field({})
    distances_m: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0, 5.0)
    seed: int = Field(0, ge=0)

    def plugins(self) -> Iterable[str | None]:
        return (self.errors,)

    @classmethod
    def planned_for(
        cls, flow: Workflow, model: str, *, minutes: int, **settings: Any
    ) -> PlannedStep:
        """Return the step as it is planned for an error model of the study.

        Parameters
        ----------
        flow
            The planned run.
        model
            Name of the error model in the study.
        minutes
            Time to request.
        settings
            Further settings of the step.
        """
        study = flow.sensor_study
        errors, options = study.study.models[model]
        seed, files = study.study.seed, study.model_files(model)
        modules, parameters = code_of_models([open_error_model(errors, options)])
        return planned(
            cls.create(errors=errors, error_options=options, seed=seed, **settings),
            {},
            *modules,
            content={"files": files},
            also=f"{parameters} {load_sensor('vlp16')} {flow.plan.digest_of(files)}",
            minutes=minutes,
        )

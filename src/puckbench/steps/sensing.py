"""Code, parameters and files on which a scan by the virtual sensor depends, besides its scene."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import Field

from pointkit.lidar.sensors import load_sensor
from pointkit.models import Model
from virtual_lidar import open_error_model, open_sweep
from virtual_lidar.errors import ErrorModel, module_of_model

if TYPE_CHECKING:
    from puckbench.steps.scan import SensorSettings


def code_of_models(models: Iterable[ErrorModel]) -> tuple[tuple[str, ...], str]:
    """Return the names of the modules that define error models, and the models' parameters.

    The parameters are one text, in the order of the models.
    """
    models = tuple(models)
    return tuple(map(module_of_model, models)), " ".join(map(str, models))


class ResidualSettings(Model):
    """How residuals of virtual scans are measured."""

    runs: int = Field(3, ge=1, description="Number of scans at each distance.")
    rows: int | None = Field(
        10_000,
        ge=1,
        description="Number of residuals that are kept of each scan, at random; null keeps all.",
    )
    refit: bool = Field(False, description="Refit the planes of RANSAC by least squares.")


class SensingCode(NamedTuple):
    """Code, parameters and files on which a scan depends, besides its scene and its settings.

    Parameters
    ----------
    modules
        Names of the modules, or paths of the user's files, that define the error model.
    parameters
        One text with the parameters of the error model, the sensor and the sweep.
    files
        Paths of the files that the settings name: of the sensor, its trajectory or its errors.
    """

    modules: tuple[str, ...]
    parameters: str
    files: list[str]


def code_of_scan(settings: SensorSettings) -> SensingCode:
    """Return the code, parameters and files on which scans with these settings depend."""
    model = open_error_model(settings.errors, settings.error_options)
    modules, parameters = code_of_models([model])
    sweep = hashlib.sha256(repr(open_sweep(settings.sweep)).encode()).hexdigest()[:16]
    named = settings.sweep.values() if isinstance(settings.sweep, Mapping) else ()
    files = files_named([settings.sensor, *named, *settings.error_options.values()])
    return SensingCode(modules, f"{parameters} {load_sensor(settings.sensor)} {sweep}", files)


def files_named(values: Iterable[Any]) -> list[str]:
    """Return those of some values that are paths of existing files."""
    return [value for value in values if isinstance(value, str) and Path(value).is_file()]

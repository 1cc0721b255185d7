"""What a scan by the virtual sensor depends on besides its scene."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pointkit.lidar.sensors import load_sensor
from puckbench.planning.config import Sensing
from virtual_lidar import open_error_model, open_sweep
from virtual_lidar.errors import ErrorModel, module_of_model

Code = tuple[tuple[str, ...], str]
"""Modules, and further data, which affect a job's result (`planned_job.planned`)."""


def code_of_models(models: Iterable[ErrorModel]) -> Code:
    """Return the names of the modules that define error models, and their parameters as one text.

    A change of either changes the results of the `models`; the text keeps their order.
    """
    models = tuple(models)
    return tuple(map(module_of_model, models)), " ".join(map(str, models))


def code_of_scan(settings: Sensing) -> Code:
    """Return what affects a scan: the error model's module, and all parameters as a text.

    The parameters are those of the error model, the sensor and the sweep.
    """
    model = open_error_model(settings.errors, settings.error_options)
    modules, parameters = code_of_models([model])
    sweep = hashlib.sha256(repr(open_sweep(settings.sweep)).encode()).hexdigest()[:16]
    return modules, f"{parameters} {load_sensor(settings.sensor)} {sweep}"


def files_of_scan(settings: Sensing) -> list[str]:
    """Return the files that the settings name: of a sensor, a trajectory or an error model."""
    sweep = settings.sweep if isinstance(settings.sweep, Mapping) else {}
    return files_named([settings.sensor, *sweep.values(), *settings.error_options.values()])


def files_named(values: Iterable[Any]) -> list[str]:
    """Return the values that are paths of files."""
    return [value for value in values if isinstance(value, str) and Path(value).is_file()]

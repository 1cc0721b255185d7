"""Code, parameters and files on which a scan by the virtual sensor depends, besides its scene."""

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
"""Names of modules, and a text of parameters, whose change makes a job run again.

They are the arguments `modules` and `also` of `puckbench.planning.planned_job.planned`.
"""


def code_of_models(models: Iterable[ErrorModel]) -> Code:
    """Return the names of the modules that define error models, and the models' parameters.

    The parameters are one text, in the order of the models.
    """
    models = tuple(models)
    return tuple(map(module_of_model, models)), " ".join(map(str, models))


def code_of_scan(settings: Sensing) -> Code:
    """Return the module of a scan's error model, and the parameters of the scan.

    The parameters are one text, with those of the error model, the sensor and the sweep. `settings`
    is the entry of a data set or drive.
    """
    model = open_error_model(settings.errors, settings.error_options)
    modules, parameters = code_of_models([model])
    sweep = hashlib.sha256(repr(open_sweep(settings.sweep)).encode()).hexdigest()[:16]
    return modules, f"{parameters} {load_sensor(settings.sensor)} {sweep}"


def files_of_scan(settings: Sensing) -> list[str]:
    """Return the paths of the files that the entry of a data set or drive names for its scans.

    Such a file defines the sensor, the sensor's trajectory or the error model's parameters.
    """
    sweep = settings.sweep if isinstance(settings.sweep, Mapping) else {}
    return files_named([settings.sensor, *sweep.values(), *settings.error_options.values()])


def files_named(values: Iterable[Any]) -> list[str]:
    """Return those of some values that are paths of existing files."""
    return [value for value in values if isinstance(value, str) and Path(value).is_file()]

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from pointkit.errors import InputError
from pointkit.files import sha256, write_bytes
from pointkit.yaml_files import yaml_text
from virtual_lidar.calibration.calibrating import FRAME, SPOT, Calibration, CalibrationOptions
from virtual_lidar.calibration.fitting import Estimate
from virtual_lidar.calibration.likelihood import NAMES
from virtual_lidar.errors.calibrated import FORMAT
from virtual_lidar.residual_table import REAL, read_residuals

# The VLP-16 gives ranges in steps of 2 mm (User Manual 63-9243 Rev. E, section 9.3).
_RECORDING_QUANTUM_M = 0.002


def read_tables(paths: Sequence[Path], model: str | None) -> tuple[list[pd.DataFrame], str]:
    """Read tables of plane residuals, and keep the rows of one error model.

    Parameters
    ----------
    paths
        Parquet or CSV files, one for each device.
    model
        Value of the column ``model`` to keep; None if the tables have only one.

    Returns
    -------
    tables
        The rows kept, in one table for each file.
    model
        The model's name.

    Raises
    ------
    InputError
        A file is no such table, or has no row of the model.
    """
    tables = [read_residuals(path) for path in paths]
    models = sorted({str(name) for table in tables for name in table["model"].unique()})
    if model is None and len(models) > 1:
        raise InputError(f"the tables have the models {', '.join(models)}: choose one")
    chosen = model or (models[0] if models else "")
    kept = [table[table["model"] == chosen] for table in tables]
    for path, table in zip(paths, kept, strict=True):
        if table.empty:
            raise InputError(f"{path}: no row of the model {chosen!r}")
    return kept, chosen


def settings_for(
    model: str,
    cells: str | None = None,
    parameters: Sequence[str] | None = None,
    quantum_mm: float | None = None,
) -> CalibrationOptions:
    """Return the options to calibrate an error model, or a real sensor (the model ``real``).

    The parameters are those of `CalibrationOptions`, with the quantum in millimetres. Those that
    are None get defaults: spots and a quantum of 2 mm (the VLP-16's) for a real sensor, frames and
    exact ranges for an error model.
    """
    real = model == REAL
    quantum_m = (_RECORDING_QUANTUM_M if real else 0.0) if quantum_mm is None else quantum_mm / 1000
    default = SPOT if real else FRAME
    return CalibrationOptions(cells or default, tuple(parameters or NAMES), quantum_m)


# A micrometre is far below the resolution of any sensor's ranges.
_DIGITS = 6


def model_file(calibration: Calibration, sources: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the content of a calibration's file, which the error model ``calibrated`` reads.

    Parameters
    ----------
    calibration
        Estimates, which are rounded to 0.001 mm.
    sources
        Descriptions of the input tables to include, such as names and hashes.

    Returns
    -------
    dict
        The format, the parameters of the error model, their 95 % intervals, the shape of the ray
        noise, and the provenance.
    """
    return {
        "format": FORMAT,
        "parameters": _parameters(calibration),
        "intervals_95": _intervals(calibration),
        "ray_noise": {
            "kurtosis": round(calibration.shape.kurtosis, 2),
            "log_likelihood_laplace_over_gaussian": round(
                calibration.shape.laplace_over_gaussian, 1
            ),
        },
        "provenance": {
            "tables": [dict(source) for source in sources],
            "counts": dict(calibration.counts),
            "cells": calibration.settings.cells,
            "estimated": list(calibration.sigmas),
            "quantum_m": calibration.settings.quantum_m,
            "version": version("virtual_lidar"),
        },
    }


def write_calibration(
    path: Path, calibration: Calibration, tables: Sequence[Path]
) -> dict[str, Any]:
    """Write a calibration to a YAML file, with names and hashes of the files in `tables`.

    Returns the content, as `model_file` does.
    """
    sources = [{"file": table.name, "sha256": sha256(table)} for table in tables]
    content = model_file(calibration, sources)
    write_bytes(path, yaml_text(content).encode())
    return content


def _parameters(calibration: Calibration) -> dict[str, Any]:
    sigmas = {name: _rounded(estimate.value) for name, estimate in calibration.sigmas.items()}
    if calibration.settings.cells == SPOT:
        # The unevenness of the walls is not an error of the sensor.
        sigmas.pop("frame_sigma_m", None)
    mean = calibration.mean
    parameters: dict[str, Any] = {
        **sigmas,
        "ray_distribution": calibration.shape.distribution,
        # A mean that does not differ significantly from zero may be an effect of the planes.
        "range_mean_m": 0.0 if mean is None or mean.low <= 0 <= mean.high else _rounded(mean.value),
        "most_incidence_rad": _rounded(calibration.most_incidence_rad),
        "ranges_m": [_rounded(estimate) for estimate in calibration.ranges_m],
    }
    if calibration.biases:
        parameters["bias_m"] = [_rounded(estimate.value) for estimate in _by_laser(calibration)]
    return parameters


def _intervals(calibration: Calibration) -> dict[str, Any]:
    ends: dict[str, Any] = {name: _ends(estimate) for name, estimate in calibration.sigmas.items()}
    if calibration.settings.cells == SPOT and "frame_sigma_m" in ends:
        unevenness = calibration.sigmas["frame_sigma_m"]
        ends["unevenness_of_the_walls_m"] = ends.pop("frame_sigma_m")
        ends["unevenness_of_the_walls_m"].insert(1, _rounded(unevenness.value))
    if calibration.mean is not None:
        ends["range_mean_m"] = _ends(calibration.mean)
    if calibration.biases:
        ends["bias_m"] = [_ends(estimate) for estimate in _by_laser(calibration)]
    return ends


def _by_laser(calibration: Calibration) -> list[Estimate]:
    # The bias of a laser without returns is 0, within two sigmas.
    reach = (
        2 * calibration.sigmas["laser_sigma_m"].value
        if "laser_sigma_m" in calibration.sigmas
        else 0.0
    )
    seen = dict(zip(calibration.laser_ids, calibration.biases, strict=True))
    unseen = Estimate(0.0, -reach, reach)
    return [seen.get(laser, unseen) for laser in range(max(calibration.laser_ids) + 1)]


def _ends(estimate: Estimate) -> list[float]:
    return [_rounded(estimate.low), _rounded(estimate.high)]


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS) + 0.0

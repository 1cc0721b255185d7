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
        Value in the column ``model`` of the rows to keep; None if all rows have the same value.

    Returns
    -------
    tables, model
        One table with the kept rows for each file; and the name of the model.

    Raises
    ------
    InputError
        A file is not a table of plane residuals, or it has no row of the model.
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
    """Return options to calibrate an error model or, if `model` is ``real``, a real sensor.

    Parameters
    ----------
    model
        Name of the error model, or ``real``.
    cells
        As in `CalibrationOptions`; by default ``"spot"`` for a real sensor and ``"frame"`` for an
        error model.
    parameters
        As in `CalibrationOptions`; by default all.
    quantum_mm
        Step to which ranges are rounded, mm; by default 2 mm (as for the VLP-16) for a real sensor
        and 0 (not rounded) for an error model.
    """
    real = model == REAL
    quantum_m = (_RECORDING_QUANTUM_M if real else 0.0) if quantum_mm is None else quantum_mm / 1000
    default = SPOT if real else FRAME
    return CalibrationOptions(cells or default, tuple(parameters or NAMES), quantum_m)


# A micrometre is far below the resolution of any sensor's ranges.
_DIGITS = 6


def model_file(calibration: Calibration, sources: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the content of a calibration file, which the error model ``calibrated`` reads.

    Parameters
    ----------
    calibration
        Estimates, which are rounded to 0.001 mm.
    sources
        Descriptions of the input tables, such as names and hashes, which are included.

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
    """Write a calibration to a YAML file, which the error model ``calibrated`` reads.

    Parameters
    ----------
    path
        The YAML file.
    calibration
        Estimates, from `calibrate`.
    tables
        The input files of the calibration, whose names and hashes are written, too.

    Returns
    -------
    dict
        The content of the file, as `model_file` returns it.
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

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pointkit.errors import InputError
from virtual_lidar.calibration.fitting import Estimate, fit, free_parameters, interval, intervals
from virtual_lidar.calibration.likelihood import NAMES, RestrictedLikelihood, Sigmas
from virtual_lidar.calibration.noise_shape import RayShape, ray_shape
from virtual_lidar.calibration.observations import Observations, observations

FRAME, SPOT = "frame", "spot"


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of a calibration.

    The returns of a cell share a bias. A cell contains the returns of one laser in one frame
    (`cells` is ``"frame"``, for virtual scans) or in one direction (``"spot"``, for a sensor at
    rest). With spots, `frame_sigma_m` is the unevenness of the walls, and the lasers' mean bias is
    assumed to be zero. `parameters` names the fields of `Sigmas` to estimate; the other fields are
    zero. Ranges are multiples of `quantum_m`.
    """

    cells: str = FRAME
    parameters: tuple[str, ...] = NAMES
    quantum_m: float = 0.0

    def __post_init__(self) -> None:
        if self.cells not in {FRAME, SPOT}:
            raise InputError(f"cells are {self.cells!r}, but must be '{FRAME}' or '{SPOT}'")
        if self.quantum_m < 0:
            raise InputError(f"quantum_m is {self.quantum_m}, but must be at least 0")


@dataclass(frozen=True)
class Calibration:
    """Estimated parameters of range errors with 95 % intervals.

    `sigmas` are estimates by name. `biases`, m, one for each laser, are relative to their mean;
    they are empty for several devices. `mean`, m, is the lasers' mean bias; None if it cannot be
    separated from the positions of the planes. `most_incidence_rad` is the largest incidence, and
    `ranges_m` are the shortest and longest range, of the returns used.
    """

    sigmas: dict[str, Estimate]
    biases: tuple[Estimate, ...]
    mean: Estimate | None
    shape: RayShape
    settings: CalibrationOptions
    laser_ids: tuple[int, ...]
    most_incidence_rad: float
    ranges_m: tuple[float, float]
    counts: dict[str, int] = field(default_factory=dict)


def calibrate(
    tables: Sequence[pd.DataFrame], settings: CalibrationOptions | None = None
) -> Calibration:
    """Estimate the parameters of range errors from one table of plane residuals per device.

    The method is restricted maximum likelihood (Patterson and Thompson, "Recovery of inter-block
    information when block sizes are unequal", Biometrika 58, 1971).
    """
    settings = settings or CalibrationOptions()
    seen = observations(tables, cells=settings.cells)
    likelihood = RestrictedLikelihood(seen, settings.quantum_m)
    free = free_parameters(seen, settings.parameters)
    best = fit(likelihood, free)
    shape = ray_shape(likelihood, best)
    sigmas = intervals(likelihood, free, best, shape.widening)
    mean, biases = _biases(likelihood, _with_lasers(best, sigmas))
    _, squares, far = seen.features.T
    return Calibration(
        sigmas=sigmas,
        biases=biases if seen.devices == 1 else (),
        mean=mean if seen.tells_mean else None,
        shape=shape,
        settings=settings,
        laser_ids=seen.laser_ids,
        most_incidence_rad=float(np.sqrt(squares.max())),
        ranges_m=(float(far.min()), float(far.max())),
        counts=_counts(seen),
    )


def _with_lasers(best: Sigmas, estimates: dict[str, Estimate]) -> Sigmas:
    lasers = estimates.get("laser_sigma_m")
    if lasers is None or lasers.value > 1e-6:
        return best
    # An estimate of zero would set all biases of lasers to zero.
    return replace(best, laser_sigma_m=lasers.high)


def _biases(
    likelihood: RestrictedLikelihood, best: Sigmas
) -> tuple[Estimate, tuple[Estimate, ...]]:
    values, covariance = likelihood.biases(best)
    lasers = len(values)
    rows = np.vstack([np.full(lasers, 1 / lasers), np.eye(lasers) - 1 / lasers])
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", rows, covariance, rows), 0))
    estimates = [interval(value, error) for value, error in zip(rows @ values, errors, strict=True)]
    return estimates[0], tuple(estimates[1:])


def _counts(seen: Observations) -> dict[str, int]:
    return {
        "devices": seen.devices,
        "lasers": len(seen.laser_ids),
        "surfaces": seen.surfaces,
        "rings": seen.scans,
        "cells": seen.cells,
        "residuals": len(seen),
    }

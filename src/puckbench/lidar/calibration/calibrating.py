"""Calibration: from tables of plane residuals to the parameters of a range error model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from puckbench.core.errors import InputError
from puckbench.lidar.calibration.fitting import (
    Estimate,
    fit,
    free_parameters,
    interval,
    intervals,
)
from puckbench.lidar.calibration.likelihood import NAMES, RestrictedLikelihood, Sigmas
from puckbench.lidar.calibration.noise_shape import RayShape, ray_shape
from puckbench.lidar.calibration.observations import Observations, observations

FRAME, SPOT = "frame", "spot"


@dataclass(frozen=True)
class CalibrationOptions:
    """How residuals are read.

    Parameters
    ----------
    cells
        What shares a bias besides the laser and the scan. ``"frame"``: one laser in one frame, as
        virtual scans draw it. ``"spot"``: one laser in one direction, for the recordings of a
        sensor that stands still. Then `frame_sigma_m` is the unevenness of the walls, the planes
        follow the means of the rings alone (the shape of a wall along a ring must not pass for an
        error of the sensor), and the lasers' mean bias, which moves a wall as a whole, is taken to
        be zero.
    parameters
        Names of the `Sigmas` to estimate; the others are zero.
    quantum_m
        Steps of the ranges, metres: 0.002 for a VLP-16, 0 for virtual scans without a receiver.

    Raises
    ------
    InputError
        Cells of another kind, or steps below zero.
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
class Domain:
    """The range of what the residuals cover.

    Parameters
    ----------
    most_incidence_rad
        Greatest angle of incidence.
    ranges_m
        Shortest and longest range.
    """

    most_incidence_rad: float
    ranges_m: tuple[float, float]


@dataclass(frozen=True)
class Calibration:
    """Estimated parameters of the range errors, each with its 95 % interval.

    Parameters
    ----------
    sigmas
        By name (`Sigmas`), those that were estimated.
    biases
        Of each laser less the mean of all, metres, in the order of `laser_ids`; none for several
        devices.
    mean
        Of the lasers' biases, metres; None where the planes hide it.
    shape
        Of the rays' noise.
    settings
        How the residuals were read.
    laser_ids
        Of the lasers that have residuals.
    domain
        Incidence and ranges of the residuals.
    counts
        Numbers of devices, lasers, surfaces, rings, cells and residuals.
    """

    sigmas: dict[str, Estimate]
    biases: tuple[Estimate, ...]
    mean: Estimate | None
    shape: RayShape
    settings: CalibrationOptions
    laser_ids: tuple[int, ...]
    domain: Domain
    counts: dict[str, int] = field(default_factory=dict)


def calibrate(
    tables: Sequence[pd.DataFrame], settings: CalibrationOptions | None = None
) -> Calibration:
    """Estimate the parameters of range errors by restricted maximum likelihood.

    Parameters
    ----------
    tables
        Plane residuals, one table per device; columns as `observations` needs them.
    settings
        How they are read; the defaults are those for virtual scans.

    Raises
    ------
    InputError
        The tables do not determine the parameters; see `observations` and `CalibrationOptions`.

    References
    ----------
    H. D. Patterson and R. Thompson, "Recovery of inter-block information when block sizes are
    unequal", Biometrika 58 (1971).
    """
    settings = settings or CalibrationOptions()
    seen = observations(tables, cells=settings.cells)
    likelihood = RestrictedLikelihood(seen, settings.quantum_m)
    free = free_parameters(seen, settings.parameters)
    best = fit(likelihood, free)
    shape = ray_shape(likelihood, best)
    sigmas = intervals(likelihood, free, best, shape.widening)
    mean, biases = _biases(likelihood, _with_lasers(best, sigmas))
    return Calibration(
        sigmas=sigmas,
        biases=biases if seen.devices == 1 else (),
        mean=mean if seen.tells_mean else None,
        shape=shape,
        settings=settings,
        laser_ids=seen.laser_ids,
        domain=_domain(seen),
        counts=_counts(seen),
    )


def _with_lasers(best: Sigmas, found: dict[str, Estimate]) -> Sigmas:
    """`best`, with the upper end of its interval for a lasers' sigma that was estimated as zero."""
    lasers = found.get("laser_sigma_m")
    if lasers is None or lasers.value > 1e-6:
        return best
    return replace(best, laser_sigma_m=lasers.high)


def _biases(
    likelihood: RestrictedLikelihood, best: Sigmas
) -> tuple[Estimate, tuple[Estimate, ...]]:
    """The lasers' mean bias, and what each is off it."""
    values, covariance = likelihood.biases(best)
    lasers = len(values)
    rows = np.vstack([np.full(lasers, 1 / lasers), np.eye(lasers) - 1 / lasers])
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", rows, covariance, rows), 0))
    found = [interval(value, error) for value, error in zip(rows @ values, errors, strict=True)]
    return found[0], tuple(found[1:])


def _domain(seen: Observations) -> Domain:
    _, squares, far = seen.features.T
    return Domain(float(np.sqrt(squares.max())), (float(far.min()), float(far.max())))


def _counts(seen: Observations) -> dict[str, int]:
    return {
        "devices": seen.devices,
        "lasers": len(seen.laser_ids),
        "surfaces": seen.surfaces,
        "rings": seen.scans,
        "cells": seen.cells,
        "residuals": len(seen),
    }

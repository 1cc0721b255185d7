from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from virtual_lidar.calibration.fitting import Estimate, fit, free_parameters, interval, intervals
from virtual_lidar.calibration.likelihood import NAMES, RestrictedLikelihood, Sigmas
from virtual_lidar.calibration.observations import Observations, observations

FRAME, SPOT = "frame", "spot"


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of `calibrate`: which parameters are estimated, and from what kind of data.

    Parameters
    ----------
    cells
        Which returns of a laser share a third bias, besides the bias of the laser and that of the
        laser in the scan. In virtual scans, ``"frame"`` means the returns of one frame. In
        recordings of a sensor at rest, ``"spot"`` means the returns in one direction; this bias is
        then the unevenness of the walls. With spots, the mean bias of all lasers is assumed to be
        0.
    parameters
        Names of the fields of `Sigmas` to estimate; the other fields are 0.
    quantum_m
        Step to which the sensor rounds its ranges, m; 0 for ranges that are not rounded.

    Raises
    ------
    InputError
        `cells` is neither ``"frame"`` nor ``"spot"``, or `quantum_m` is negative.
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
    """Result of `calibrate`: estimated parameters of a sensor's range errors, with 95 % intervals.

    Parameters
    ----------
    sigmas
        Estimates of the fields of `Sigmas`, by the name of the field and in the unit of the field.
    biases
        Bias of each laser in `laser_ids`, relative to their mean, m; empty for several devices.
    mean
        Mean bias of all lasers, m; None if it cannot be separated from the positions of the planes.
    shape
        Distribution of the ray noise.
    settings
        Options of the calibration.
    laser_ids
        Numbers of the lasers that were seen.
    most_incidence_rad, ranges_m
        Largest incidence, and shortest and longest range, of the returns that were used.
    counts
        Numbers of devices, lasers, surfaces, pairs of laser and scan (``rings``), cells and
        residuals.
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
    """Estimate how a sensor's ranges err, from the distances of its points from fitted planes.

    The method is restricted maximum likelihood, which accounts for the errors that the fit of the
    planes hides (Patterson and Thompson, "Recovery of inter-block information when block sizes are
    unequal", Biometrika 58, 1971).

    Parameters
    ----------
    tables
        Tables of plane residuals (`virtual_lidar.residual_table.COLUMNS`), one for each device.
    settings
        Options; the default is for a virtual scan with exact ranges.

    Returns
    -------
    Calibration
        The estimates; `write_calibration` makes a file of them for the error model ``calibrated``.

    Raises
    ------
    InputError
        A table lacks a column or has invalid values, or there are too few residuals or lasers.
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


# The standard deviation of a Laplace distribution is sqrt(2) b.
_ROOT = np.sqrt(2.0)


@dataclass(frozen=True)
class RayShape:
    """The distribution of the ray noise: Gaussian or Laplace.

    Parameters
    ----------
    distribution
        The more likely distribution, ``"gaussian"`` or ``"laplace"``.
    laplace_over_gaussian
        Logarithm of the likelihood of Laplace noise divided by that of Gaussian noise; it is
        positive if Laplace noise is more likely.
    kurtosis
        Kurtosis of the noise: 3 for Gaussian noise, 6 for Laplace noise.
    """

    distribution: str
    laplace_over_gaussian: float
    kurtosis: float

    @property
    def widening(self) -> float:
        """Factor by which a sigma's standard error exceeds that for Gaussian noise.

        The score of a scale parameter is ``e^2 - 1`` for standardised noise e; its variance is the
        kurtosis minus one (2 for Gaussian noise).
        """
        return float(np.sqrt(max(self.kurtosis - 1, 0.5) / 2))


def ray_shape(likelihood: RestrictedLikelihood, sigmas: Sigmas) -> RayShape:
    """Estimate the distribution of the ray noise from pairs of successive returns.

    A pair is two successive returns of one laser on one surface; their common biases cancel. With
    fewer than 30 pairs, the result is Gaussian.
    """
    pairs = _standard_differences(likelihood, sigmas)
    if len(pairs) < 30:
        return RayShape("gaussian", 0.0, 3.0)
    gain = float(np.sum(_log_laplace(pairs) - _log_gaussian(pairs)))
    # The excess kurtosis of the difference of two noises is half of that of one.
    kurtosis = 2 * float(np.mean(pairs**4) / np.mean(pairs**2) ** 2) - 3
    return RayShape("laplace" if gain > 0 else "gaussian", gain, kurtosis)


def _standard_differences(likelihood: RestrictedLikelihood, sigmas: Sigmas) -> Floats:
    seen = likelihood.seen
    group = np.repeat(np.arange(len(seen.surface)), np.diff(seen.groups))
    first = np.flatnonzero((np.arange(len(seen)) - seen.groups[group]) % 2 == 0)
    first = first[first + 1 < len(seen)]
    first = first[group[first] == group[first + 1]]
    variance = likelihood.variances(sigmas)
    scale = np.sqrt((variance[first] + variance[first + 1]) / 2)
    return np.asarray((seen.error[first + 1] - seen.error[first]) / scale)


def _log_gaussian(difference: Floats) -> Floats:
    return np.asarray(-(difference**2) / 4 - np.log(2 * np.sqrt(np.pi)))


def _log_laplace(difference: Floats) -> Floats:
    # The density is (1 + |d| / b) exp(-|d| / b) / (4 b), for two Laplace noises of variance 1.
    scaled = np.abs(difference) * _ROOT
    return np.asarray(np.log1p(scaled) - scaled + np.log(_ROOT / 4))

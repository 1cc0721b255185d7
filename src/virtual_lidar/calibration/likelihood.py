"""Restricted likelihood of range errors: plane parameters are integrated out.

The model is ``error = mean + laser bias + scan bias + frame bias + ray noise``. Biases are normally
distributed, per laser of a device, per laser and scan, and per laser and frame. Planes and mean
have a flat prior, so that fitting planes to the noise does not bias the sigmas.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from virtual_lidar.calibration.kernels import (
    LOGARITHMS,
    SQUARES,
    WIDTH,
    Columns,
    eliminate_cell_biases,
    eliminate_scan_biases,
    group_sums,
    solved,
)
from virtual_lidar.calibration.observations import Observations

_LEAST_SIGMA_M = 1e-6


@dataclass(frozen=True)
class Sigmas:
    """Parameters of a sensor's range errors, as `calibrate` estimates them.

    Each laser has three biases: one is drawn for the device, one for each scan, and one for each
    frame (or spot, see `CalibrationOptions`). Their standard deviations are `laser_sigma_m`,
    `scan_sigma_m` and `frame_sigma_m`. In addition, each ray has noise. For a ray of the incidence
    theta (rad) and the range r (m), its standard deviation is ``ray_sigma_m + ray_incidence_m *
    theta^2 + ray_range * r``.
    """

    laser_sigma_m: float = 0.0
    scan_sigma_m: float = 0.0
    frame_sigma_m: float = 0.0
    ray_sigma_m: float = 0.0
    ray_incidence_m: float = 0.0
    ray_range: float = 0.0

    @property
    def ray(self) -> tuple[float, float, float]:
        return self.ray_sigma_m, self.ray_incidence_m, self.ray_range


NAMES = tuple(sigma.name for sigma in fields(Sigmas))
BIASES, RAYS = NAMES[:3], NAMES[3:]
"""Names of the biases' sigmas (at least 0), and of the parameters of ray noise."""


@dataclass(frozen=True)
class Equations:
    """Normal equations ``matrix @ x = right`` for range errors z with covariance V.

    Parameters
    ----------
    squares
        The number ``z' V^-1 z``.
    log_determinant
        The number ``log |V|``.
    """

    matrix: Floats
    right: Floats
    squares: float
    log_determinant: float


@dataclass(frozen=True)
class RestrictedLikelihood:
    """Restricted likelihood of observed range errors, as a function of their parameters.

    Parameters
    ----------
    seen
        The observations.
    quantum_m
        Step to which the sensor rounds ranges, m. Rounding adds ``quantum_m^2 / 12`` to the
        variance of a ray.
    """

    seen: Observations
    quantum_m: float = 0.0
    _kept: dict[tuple[float, float, float], Floats] = field(default_factory=dict, repr=False)

    def deviance(self, sigmas: Sigmas) -> float:
        """Return minus twice the restricted log-likelihood of parameters, up to a constant.

        Raises InputError if the planes and the biases cannot be separated.
        """
        equations = self._mixed(sigmas)
        determinant, explained = solved(equations.matrix, equations.right)
        if not np.isfinite(determinant):
            raise InputError(_NOT_TOLD)
        return equations.log_determinant + determinant + equations.squares - explained

    def biases(self, sigmas: Sigmas) -> tuple[Floats, Floats]:
        """Estimate the bias of each laser by the best linear unbiased prediction.

        Parameters
        ----------
        sigmas
            Parameters of the range errors.

        Returns
        -------
        tuple of arrays
            The biases, (lasers,), m, and their covariance matrix, (lasers, lasers), m^2.
        """
        equations, planes = self._mixed(sigmas), 3 * self.seen.surfaces
        covariance = np.linalg.inv(equations.matrix)
        parts = self._in_parts(np.eye(planes + len(self.seen.laser_ids)), sigmas)[:, planes:].T
        return parts @ (covariance @ equations.right), parts @ covariance @ parts.T

    def variances(self, sigmas: Sigmas) -> Floats:
        """Return the variance of each range, (n,), m^2, due to ray noise and rounding."""
        scale = np.maximum(self.seen.features @ np.array(sigmas.ray), _LEAST_SIGMA_M)
        return np.asarray(scale**2 + self.quantum_m**2 / 12)

    def _sums(self, ray: tuple[float, float, float]) -> Floats:
        if ray not in self._kept:
            seen, least = self.seen, (_LEAST_SIGMA_M, self.quantum_m**2 / 12)
            sums = np.empty((len(seen.surface), WIDTH))
            group_sums(seen.groups, (seen.error, seen.basis, seen.features), ray, least, sums)
            # Most steps of a search change only sigmas of biases, so the last sums are kept.
            self._kept.clear()
            self._kept[ray] = sums
        return self._kept[ray]

    def _mixed(self, sigmas: Sigmas) -> Equations:
        """Return Henderson's mixed model equations for planes, mean and scaled laser biases."""
        equations = self._without_drawn_biases(sigmas)
        rows = self._in_parts(equations.matrix, sigmas)
        matrix = self._in_parts(rows.T, sigmas)
        lasers = len(matrix) - 3 * self.seen.surfaces - int(self.seen.tells_mean)
        drawn = np.arange(len(matrix) - lasers, len(matrix))
        matrix[drawn, drawn] += 1.0
        right = self._in_parts(equations.right[:, None], sigmas)[:, 0]
        return Equations(matrix, right, equations.squares, equations.log_determinant)

    def _in_parts(self, rows: Floats, sigmas: Sigmas) -> Floats:
        """Transform laser biases to their mean and scaled deviations from the mean."""
        planes = 3 * self.seen.surfaces
        lasers = rows[planes:]
        mean = lasers.sum(axis=0)[None, :] if self.seen.tells_mean else lasers[:0]
        drawn = sigmas.laser_sigma_m * lasers if sigmas.laser_sigma_m > 0 else lasers[:0]
        return np.vstack([rows[:planes], mean, drawn])

    def _without_drawn_biases(self, sigmas: Sigmas) -> Equations:
        seen, sums = self.seen, self._sums(sigmas.ray)
        lasers = 3 * seen.surfaces
        core = lasers + len(seen.laser_ids)
        matrix, right = np.zeros((core + seen.scans,) * 2), np.zeros(core + seen.scans)
        columns = Columns(seen.cell, seen.surface, seen.laser + lasers, seen.scan + core)
        of_cells = eliminate_cell_biases(columns, sums, sigmas.frame_sigma_m**2, matrix, right)
        of_scans = eliminate_scan_biases(core, sigmas.scan_sigma_m**2, matrix, right)
        return Equations(
            matrix[:core, :core],
            right[:core],
            float(sums[:, SQUARES].sum() - of_cells[0] - of_scans[0]),
            float(sums[:, LOGARITHMS].sum() + of_cells[1] + of_scans[1]),
        )


_NOT_TOLD = "the residuals cannot separate the planes from the biases: more lasers are needed"

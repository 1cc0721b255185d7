"""The restricted likelihood of a range error model: what the fitted planes took is integrated out.

The model: ``error = mean + laser bias + scan bias + frame bias + ray noise``, each bias normal with
a sigma of its own and drawn per laser of a device, per laser and scan, per laser and frame; the
ray's sigma is ``ray + incidence * theta^2 + range * r``. The three parameters of every plane and
the mean are integrated over a flat prior (Patterson and Thompson 1971), which for a linear model is
the same as to project them out of the data: estimates of the sigmas do not shrink by what the
planes followed of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.lidar.calibration.kernels import (
    LOGARITHMS,
    SQUARES,
    WIDTH,
    absorb_cells,
    absorb_scans,
    group_sums,
    solved,
)
from puckbench.lidar.calibration.observations import Observations

_LEAST_SIGMA_M = 1e-6


@dataclass(frozen=True)
class Sigmas:
    """The parameters that are estimated.

    The sigma of a ray's noise is ``ray_sigma_m + ray_incidence_m * theta^2 + ray_range * r`` with
    the incidence theta and the range r.

    Parameters
    ----------
    laser_sigma_m
        Of a laser's bias, from device to device, metres.
    scan_sigma_m, frame_sigma_m
        Of the biases of a laser that are redrawn for every scan and for every frame, metres.
    ray_sigma_m, ray_incidence_m, ray_range
        Of a ray's noise: metres, metres per rad^2, metres per metre.
    """

    laser_sigma_m: float = 0.0
    scan_sigma_m: float = 0.0
    frame_sigma_m: float = 0.0
    ray_sigma_m: float = 0.0
    ray_incidence_m: float = 0.0
    ray_range: float = 0.0

    @property
    def ray(self) -> tuple[float, float, float]:
        """Coefficients of `Observations.features`."""
        return self.ray_sigma_m, self.ray_incidence_m, self.ray_range


NAMES = tuple(one.name for one in fields(Sigmas))
BIASES, RAYS = NAMES[:3], NAMES[3:]
"""The sigmas of biases, which are not below zero and may be zero, and what makes a ray's."""


@dataclass(frozen=True)
class Equations:
    """Normal equations, and the terms of the likelihood that are not in them.

    Parameters
    ----------
    matrix, right
        (p, p) and (p,).
    squares
        ``z' V^-1 z`` of the errors z with their covariance V.
    log_determinant
        ``log |V|``.
    """

    matrix: Floats
    right: Floats
    squares: float
    log_determinant: float


@dataclass(frozen=True)
class RestrictedLikelihood:
    """The restricted likelihood of observations.

    Parameters
    ----------
    seen
        The observations.
    quantum_m
        Steps of the measured ranges, metres, whose rounding adds ``quantum^2 / 12`` to the variance
        of a ray (Sheppard): it matters for a ray's sigma below about the quantum.
    """

    seen: Observations
    quantum_m: float = 0.0
    _kept: dict[tuple[float, float, float], Floats] = field(default_factory=dict, repr=False)

    def deviance(self, sigmas: Sigmas) -> float:
        """Minus twice the restricted log-likelihood, up to a constant.

        Raises
        ------
        InputError
            The residuals do not separate the planes from the biases.
        """
        found = self._mixed(sigmas)
        determinant, explained = solved(found.matrix, found.right)
        if not np.isfinite(determinant):
            raise InputError(_NOT_TOLD)
        return found.log_determinant + determinant + found.squares - explained

    def biases(self, sigmas: Sigmas) -> tuple[Floats, Floats]:
        """Predict the biases of the lasers, given the sigmas and the residuals.

        This is the best linear unbiased prediction: what the residuals cannot determine, such as a
        trend over one wall that its plane could have followed, is zero.

        Returns
        -------
        biases, covariance
            (lasers,) metres, their mean included, and (lasers, lasers) m^2.
        """
        found, planes = self._mixed(sigmas), 3 * self.seen.surfaces
        covariance = np.linalg.inv(found.matrix)
        parts = self._in_parts(np.eye(planes + len(self.seen.laser_ids)), sigmas)[:, planes:].T
        return parts @ (covariance @ found.right), parts @ covariance @ parts.T

    def variances(self, sigmas: Sigmas) -> Floats:
        """Variance of each ray's noise, (n,) m^2, with that of the quantum."""
        scale = np.maximum(self.seen.features @ np.array(sigmas.ray), _LEAST_SIGMA_M)
        return np.asarray(scale**2 + self.quantum_m**2 / 12)

    def _sums(self, ray: tuple[float, float, float]) -> Floats:
        """Sums of each group; the last ones are kept, for most searches leave the rays alone."""
        if ray not in self._kept:
            seen, least = self.seen, (_LEAST_SIGMA_M, self.quantum_m**2 / 12)
            sums = np.empty((len(seen.surface), WIDTH))
            group_sums(seen.groups, (seen.error, seen.basis, seen.features), ray, least, sums)
            self._kept.clear()
            self._kept[ray] = sums
        return self._kept[ray]

    def _mixed(self, sigmas: Sigmas) -> Equations:
        """Henderson's equations of planes, mean and lasers, the latter in units of their sigma.

        So the lasers' prior is the unit matrix; a part that there is not has no row.
        """
        found = self._absorbed(sigmas)
        rows = self._in_parts(found.matrix, sigmas)
        matrix = self._in_parts(rows.T, sigmas)
        lasers = len(matrix) - 3 * self.seen.surfaces - int(self.seen.tells_mean)
        drawn = np.arange(len(matrix) - lasers, len(matrix))
        matrix[drawn, drawn] += 1.0
        right = self._in_parts(found.right[:, None], sigmas)[:, 0]
        return Equations(matrix, right, found.squares, found.log_determinant)

    def _in_parts(self, rows: Floats, sigmas: Sigmas) -> Floats:
        """Rows of planes and lasers as rows of planes, mean (if any) and lasers' units (if any)."""
        planes = 3 * self.seen.surfaces
        lasers = rows[planes:]
        mean = lasers.sum(axis=0)[None, :] if self.seen.tells_mean else lasers[:0]
        drawn = sigmas.laser_sigma_m * lasers if sigmas.laser_sigma_m > 0 else lasers[:0]
        return np.vstack([rows[:planes], mean, drawn])

    def _absorbed(self, sigmas: Sigmas) -> Equations:
        """Normal equations of planes and lasers, the biases of cells and of scans left out."""
        seen, sums = self.seen, self._sums(sigmas.ray)
        lasers = 3 * seen.surfaces
        core = lasers + len(seen.laser_ids)
        matrix, right = np.zeros((core + seen.scans,) * 2), np.zeros(core + seen.scans)
        codes = (seen.cell, seen.surface, seen.laser + lasers, seen.scan + core)
        of_cells = absorb_cells(codes, sums, sigmas.frame_sigma_m**2, matrix, right)
        of_scans = absorb_scans(core, sigmas.scan_sigma_m**2, matrix, right)
        return Equations(
            matrix[:core, :core],
            right[:core],
            float(sums[:, SQUARES].sum() - of_cells[0] - of_scans[0]),
            float(sums[:, LOGARITHMS].sum() + of_cells[1] + of_scans[1]),
        )


_NOT_TOLD = "the residuals do not tell the planes from the biases: more lasers are needed"

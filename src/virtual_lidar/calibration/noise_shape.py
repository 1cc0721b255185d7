"""Distribution of ray noise, Gaussian or Laplace, and its kurtosis.

The differences between successive returns of a laser on a surface are free of biases.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.calibration.likelihood import RestrictedLikelihood, Sigmas

# The standard deviation of a Laplace distribution is sqrt(2) b.
_ROOT = np.sqrt(2.0)


@dataclass(frozen=True)
class RayShape:
    """Distribution of ray noise, log-likelihood ratio of Laplace to Gaussian, and kurtosis."""

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
    """Estimate the distribution of ray noise; assume Gaussian noise below 30 pairs of returns."""
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

"""The shape of the rays' noise: Gaussian or Laplace, and how heavy its tails are.

Two returns of one laser that follow each other on one surface share bias and plane, so that their
difference is one of two rays' noises alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.lidar.calibration.likelihood import RestrictedLikelihood, Sigmas

# The standard deviation of Laplace noise is the root of two times its b.
_ROOT = np.sqrt(2.0)


@dataclass(frozen=True)
class RayShape:
    """The shape of the rays' noise.

    Parameters
    ----------
    distribution
        ``"gaussian"`` or ``"laplace"``, whichever makes the differences of neighbours more likely.
    laplace_over_gaussian
        Logarithm of the ratio of their likelihoods.
    kurtosis
        Of a ray's noise: 3 for Gaussian noise and 6 for Laplace noise.
    """

    distribution: str
    laplace_over_gaussian: float
    kurtosis: float

    @property
    def widening(self) -> float:
        """The factor by which the standard errors of a sigma exceed those of Gaussian noise.

        The score of a scale is ``e^2 - 1``, whose variance is the kurtosis less one, 2 for Gaussian
        noise: so Gaussian likelihood serves any noise, with this factor in its intervals (White
        1982).
        """
        return float(np.sqrt(max(self.kurtosis - 1, 0.5) / 2))


def ray_shape(likelihood: RestrictedLikelihood, sigmas: Sigmas) -> RayShape:
    """Tell the shape of the rays' noise from differences of neighbouring returns.

    Parameters
    ----------
    likelihood
        Of the observations.
    sigmas
        The estimates, which give the scale of each ray's noise.

    Returns
    -------
    RayShape
        Gaussian where there are fewer than 30 pairs of neighbours.
    """
    pairs = _standard_differences(likelihood, sigmas)
    if len(pairs) < 30:
        return RayShape("gaussian", 0.0, 3.0)
    gain = float(np.sum(_log_laplace(pairs) - _log_gaussian(pairs)))
    # Of the sum of two alike the excess is half that of one.
    kurtosis = 2 * float(np.mean(pairs**4) / np.mean(pairs**2) ** 2) - 3
    return RayShape("laplace" if gain > 0 else "gaussian", gain, kurtosis)


def _standard_differences(likelihood: RestrictedLikelihood, sigmas: Sigmas) -> Floats:
    """Differences of pairs of following returns of one group, in units of one ray's sigma."""
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
    """Of the difference of two Laplace noises: ``(1 + |d| / b) exp(-|d| / b) / (4 b)``."""
    scaled = np.abs(difference) * _ROOT
    return np.asarray(np.log1p(scaled) - scaled + np.log(_ROOT / 4))

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pointkit.errors import InputError, among
from pointkit.geometry.cloud import Floats
from virtual_lidar.calibration.likelihood import BIASES, NAMES, RAYS, RestrictedLikelihood, Sigmas
from virtual_lidar.calibration.observations import Observations

# Increase of the deviance at the ends of a 95 % interval (chi squared, one degree of freedom).
DEVIANCE_95 = 3.841458820694124
_NORMAL_95 = 1.959963984540054
# Above this relative standard error a sigma's likelihood is not symmetric: the profile is used.
_SHARP = 0.1
_MM = 1e-3
# Condition number of the scaled features of a ray's sigma, above which they are collinear.
_MOST_CONDITION = 1e4
# Deviance of a step that is so large that the equations become singular: it is rejected.
_TOO_FAR = 1e9
# Limit of further searches, and the least decrease of the deviance for another one.
_SEARCHES, _NO_GAIN = 10, 1e-3


@dataclass(frozen=True)
class Estimate:
    """An estimated value with the lower and upper end of its 95 % interval."""

    value: float
    low: float
    high: float


def free_parameters(seen: Observations, requested: Sequence[str] = NAMES) -> tuple[str, ...]:
    """Return the names of those requested parameters that the observations can determine.

    For example, the sigma of biases per scan can only be estimated if a laser has several scans.
    Raises InputError for an unknown name, or if the effects of incidence and range cannot be
    separated.
    """
    for name in requested:
        if name not in NAMES:
            raise InputError(f"unknown parameter {name!r}{among(name, NAMES)}")
    lasers = len(seen.laser_ids)
    repeated = {"laser_sigma_m": lasers > 2, "scan_sigma_m": seen.scans > lasers}
    repeated["frame_sigma_m"] = seen.cells > seen.scans
    chosen = [
        name
        for name in NAMES
        if name == "ray_sigma_m" or (name in requested and repeated.get(name, True))
    ]
    _check_features(seen, [RAYS.index(name) for name in chosen if name in RAYS])
    return tuple(chosen)


def _check_features(seen: Observations, chosen: Sequence[int]) -> None:
    features = seen.features[:, chosen]
    if np.linalg.cond(features / np.linalg.norm(features, axis=0)) > _MOST_CONDITION:
        raise InputError(
            "the residuals cannot separate incidence from range: omit ray_incidence_m or ray_range"
        )


def fit(
    likelihood: RestrictedLikelihood, free: Sequence[str], start: Sigmas | None = None
) -> Sigmas:
    """Return the parameters that maximise the restricted likelihood.

    Parameters
    ----------
    likelihood
        Likelihood of the observations.
    free
        Names of the parameters that may change; the others stay as in `start`.
    start
        Parameters at which the search begins, by default from the spread of the errors.
    """
    first = start or _start(likelihood, free)
    if not free:
        return first
    deviance = _in_millimetres(likelihood, free, first)
    lowest = deviance(_values(first, free))

    def above(values: Floats) -> float:
        try:
            return deviance(values) - lowest
        except InputError:  # only a step that is too large does not separate planes and biases
            return _TOO_FAR

    bounds = [(0.0, None) if name in BIASES else (None, None) for name in free]
    best = _searched(above, _values(first, free), np.ones(len(free)), bounds)
    for _ in range(_SEARCHES):
        # Some sigmas are ten thousand times more precise than others, so that a search in
        # millimetres may stop too early. It continues in steps that raise the deviance equally.
        steps = np.array([_step(above, best, i) for i in range(len(free))])
        again = _searched(above, best, steps, bounds)
        if above(again) > above(best) - _NO_GAIN:
            break
        best = again
    return _sigmas(best, free, first)


def _searched(
    above: Deviance, start: Floats, units: Floats, bounds: Sequence[tuple[float | None, None]]
) -> Floats:
    from scipy import optimize

    minimize: Any = optimize.minimize  # its stubs do not allow pairs as bounds
    optimum = minimize(
        lambda values: above(values * units),
        start / units,
        method="L-BFGS-B",
        bounds=bounds,
        options={"ftol": 1e-10, "gtol": 0.02, "eps": 1e-4, "maxiter": 200},
    )
    return np.asarray(optimum.x * units)


def intervals(
    likelihood: RestrictedLikelihood, free: Sequence[str], best: Sigmas, widening: float = 1.0
) -> dict[str, Estimate]:
    """Return the estimate and 95 % interval of each parameter in `free`, by name.

    Intervals come from the curvature of the likelihood at its maximum `best` (observed Fisher
    information). If the standard error of a bias's sigma exceeds 10 %, the interval comes from the
    profile likelihood, and may begin at zero. Intervals of ray noise are made wider by the factor
    `widening`, since noise that is not Gaussian makes them less certain (`RayShape.widening`).
    """
    deviance = _in_millimetres(likelihood, free, best)
    centre = _values(best, free)
    errors = _standard_errors(deviance, centre, free)
    estimates: dict[str, Estimate] = {}
    for name, value, error in zip(free, centre, errors, strict=True):
        if name in BIASES and not error < _SHARP * value:
            estimates[name] = _profile(likelihood, free, best, name)
        else:
            wide = error if name in BIASES else error * widening
            estimates[name] = interval(value * _MM, wide * _MM)
    return estimates


def interval(value: float, error: float) -> Estimate:
    """Return a value with the 95 % interval that follows from its standard error."""
    value, reach = float(value), _NORMAL_95 * float(error)
    return Estimate(value, value - reach, value + reach)


Deviance = Callable[[Floats], float]


def _in_millimetres(
    likelihood: RestrictedLikelihood, free: Sequence[str], base: Sigmas
) -> Deviance:
    return lambda values: likelihood.deviance(_sigmas(values, free, base))


def _values(sigmas: Sigmas, free: Sequence[str]) -> Floats:
    return np.array([getattr(sigmas, name) / _MM for name in free])


def _sigmas(values: Floats, free: Sequence[str], base: Sigmas) -> Sigmas:
    return replace(base, **dict(zip(free, (float(value) * _MM for value in values), strict=True)))


def _start(likelihood: RestrictedLikelihood, free: Sequence[str]) -> Sigmas:
    seen = likelihood.seen
    count = np.diff(seen.groups)
    within = np.repeat(np.add.reduceat(seen.error, seen.groups[:-1]) / count, count)
    spread = float(np.sqrt(np.mean((seen.error - within) ** 2))) or 1e-4
    return Sigmas(**{name: spread for name in free if name in {*BIASES, "ray_sigma_m"}})


def _standard_errors(deviance: Deviance, centre: Floats, free: Sequence[str]) -> Floats:
    inner = [i for i, name in enumerate(free) if name not in BIASES or centre[i] > 1e-3]
    steps = np.array([_step(deviance, centre, i) for i in inner])
    curvature = _curvature(deviance, centre, inner, steps)
    errors = np.full(len(centre), np.nan)
    errors[inner] = steps * np.sqrt(np.maximum(np.diag(2 * np.linalg.inv(curvature)), 0))
    return errors


def _step(deviance: Deviance, centre: Floats, index: int) -> float:
    step, lowest = 0.01 * max(abs(float(centre[index])), 0.1), deviance(centre)
    for _ in range(4):
        aside = centre.copy()
        aside[index] += step
        rise = deviance(aside) - lowest
        if 0.3 < rise < 3:
            break
        step *= float(np.clip(np.sqrt(1 / max(rise, 1e-4)), 0.02, 50))
    return step


def _curvature(deviance: Deviance, centre: Floats, inner: Sequence[int], steps: Floats) -> Floats:
    result = np.empty((len(inner), len(inner)))

    def at(*moves: tuple[int, float]) -> float:
        aside = centre.copy()
        for i, direction in moves:
            aside[inner[i]] += direction * steps[i]
        return deviance(aside)

    lowest = deviance(centre)
    for i in range(len(inner)):
        result[i, i] = at((i, 1)) + at((i, -1)) - 2 * lowest
        for j in range(i):
            crossed = at((i, 1), (j, 1)) - at((i, 1), (j, -1))
            crossed += at((i, -1), (j, -1)) - at((i, -1), (j, 1))
            result[i, j] = result[j, i] = crossed / 4
    return result


def _profile(
    likelihood: RestrictedLikelihood, free: Sequence[str], best: Sigmas, name: str
) -> Estimate:
    from scipy.optimize import brentq

    # The rays' sigma is thousands of times more precise, and fixed.
    others = tuple(parameter for parameter in free if parameter in BIASES and parameter != name)
    lowest, value = likelihood.deviance(best), float(getattr(best, name))

    def excess(held: float) -> float:
        fitted = fit(likelihood, others, replace(best, **{name: held}))
        return likelihood.deviance(fitted) - lowest - DEVIANCE_95

    low = 0.0 if value <= 1e-6 or excess(0.0) <= 0 else brentq(excess, 0.0, value, xtol=1e-5)
    high = max(2 * value, 1e-3)
    while excess(high) < 0:
        high *= 2
    return Estimate(value, float(low), float(brentq(excess, value, high, xtol=1e-5)))

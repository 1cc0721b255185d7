"""Interpolation of a codec's rate-distortion curve: the bits that a given error needs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pointkit.geometry.cloud import Floats


def bits_at_error(bits: Iterable[float], errors: Iterable[float], error: float) -> float:
    """Return the fewest bits with which a codec reaches an error, interpolated between lossy rates.

    Rates without error are left out, and nothing is extrapolated.

    Parameters
    ----------
    bits
        Bits (n,) of a codec's rates, in any order.
    errors
        Errors (n,) at these rates.
    error
        The error to reach, in the unit of `errors`.

    Returns
    -------
    float
        The bits, interpolated as by `bits_to_reach`. It is nan if fewer than two rates are lossy,
        or if `error` is below the smallest or above the largest of their errors.
    """
    rate, distance = (np.asarray(list(values), np.float64) for values in (bits, errors))
    lossy = distance > 0
    rate, distance = rate[lossy], distance[lossy]
    if len(distance) < 2 or not distance.min() <= error <= distance.max():
        return float("nan")
    order = np.lexsort((distance, rate))
    return bits_to_reach(rate[order], distance[order], error)


def bits_to_reach(bits: Floats, errors: Floats, goal: float) -> float:
    """Return the fewest bits with which a codec's error is at most `goal`.

    The first rate with such an error counts. If a rate with fewer bits precedes it, the bits at
    which the error equals `goal` are interpolated between both, linearly in log bits and log error.
    There is no interpolation if the first rate has no error at all.

    Parameters
    ----------
    bits
        Bits (n,) of a codec's rates, ascending.
    errors
        Errors (n,) at these rates; rates with nan are left out.
    goal
        Largest allowed error, in the unit of `errors`.

    Returns
    -------
    float
        The bits, or nan if no rate reaches the goal.
    """
    known = ~np.isnan(errors)
    bits, errors = bits[known], errors[known]
    near = np.flatnonzero(errors <= goal)
    if len(near) == 0:
        return float("nan")
    first = near[0]
    if first == 0 or errors[first] <= 0:
        return float(bits[first])
    pair = slice(first - 1, first + 1)
    log_errors, log_bits = np.log(errors[pair])[::-1], np.log(bits[pair])[::-1]
    return float(np.exp(np.interp(np.log(goal), log_errors, log_bits)))

"""Bits of a rate-distortion curve at a given error."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pointkit.geometry.cloud import Floats


def bits_at_error(bits: Iterable[float], errors: Iterable[float], error: float) -> float:
    """Return the fewest bits at an error, or nan outside the range of the errors above 0.

    `bits` and `errors` (n,) are of a curve's rates; see `bits_to_reach`.
    """
    rate, distance = (np.asarray(list(values), np.float64) for values in (bits, errors))
    lossy = distance > 0
    rate, distance = rate[lossy], distance[lossy]
    if len(distance) < 2 or not distance.min() <= error <= distance.max():
        return float("nan")
    order = np.lexsort((distance, rate))
    return bits_to_reach(rate[order], distance[order], error)


def bits_to_reach(bits: Floats, errors: Floats, goal: float) -> float:
    """Return the fewest bits at which a curve's error is at most `goal`, or nan.

    `bits` (n,) ascend; rates whose error is nan are left out. The first rate that is near enough
    counts, or, if the rate before it has fewer bits, the point between both at which the error is
    `goal`, linear in log bits and log error. Next to a rate without error nothing is interpolated.
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

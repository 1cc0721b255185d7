"""The exponential function without a mathematical library, since libraries round differently."""

from __future__ import annotations

import math

import numpy as np

from pointkit.compiling import compiled

_LEAST_EXPONENT = 64
_POWERS = 2.0 ** np.arange(-_LEAST_EXPONENT, 1)
_TERMS = np.array([1 / math.factorial(n) for n in range(13, -1, -1)])
_LOG2_E, _LN_2 = 1 / math.log(2), math.log(2)


@compiled
def exponential(x: float) -> float:
    """Return e to the power of x, where x <= 0, with a relative error of about 1e-14.

    The result is 0 for x below -44, and NaN if x is NaN or infinite.
    """
    if not -44.0 < x <= 0.0:
        return 0.0 * x  # NaN for a NaN or infinite x
    power = math.floor(x * _LOG2_E + 0.5)
    remainder = x - power * _LN_2
    total = _TERMS[0]
    for k in range(1, len(_TERMS)):
        total = total * remainder + _TERMS[k]
    result: float = total * _POWERS[np.int64(power) + _LEAST_EXPONENT]
    return result

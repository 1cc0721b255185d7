"""Experts: estimates of a number, each with a scale, as probabilities of binary decisions.

An expert believes that a number lies around its mean, with a spread that was learnt where its
errors were alike. A decision asks whether the number is in the upper part of an interval; the
expert's answer is the logit of its distribution's share there.
"""

from __future__ import annotations

from functools import cache
from math import erf, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.binary_coder import UNIT
from puckbench.core.compiling import inlined
from puckbench.puck.mixing import Ints, Many, Words

FINE = 16
"""Means and errors are in units of 1 / FINE."""
_WHOLE = 4096
"""Probability 1 of the experts' distributions."""
_REACH = 1024
"""Entries of the table of the distribution on each side of its mean."""
_PER_ERROR = 128
"""Entries of that table in a mean absolute error."""
_LEAST_SCALE = 2 * 256
_INVERSE = _PER_ERROR * 256 << 13
_FARTHEST = 4000
"""Largest error that a scale learns from."""


class Experts(NamedTuple):
    """State of a number's experts.

    means: (experts,), 0 for an expert that has none. inverse: (experts,), of the scales. lower,
    upper: (experts,), the distribution at the ends of the interval. asked: (experts,), the
    distribution at the edge of the last decision. scales: (experts, situations), mean
    absolute errors in 1 / 256 of FINE. distribution, logits: tables. every: a tuple, as long as
    there are experts.
    """

    means: Ints
    inverse: Ints
    lower: Ints
    upper: Ints
    asked: Ints
    scales: Words
    distribution: NDArray[np.int16]
    logits: NDArray[np.int16]
    every: Many


def new_experts(scales: Words, count: int) -> Experts:
    """Experts with their first scales (scales, situations), of which there may be more."""
    spaces = np.zeros((5, count), np.int64)
    means, inverse, lower, upper, asked = spaces
    return Experts(means, inverse, lower, upper, asked, scales, *_tables(), (0,) * count)


@cache
def _tables() -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Distribution of a number (Gaussian with a wide foot), and 256 times the logarithm."""
    errors = np.arange(-_REACH, _REACH + 1) / _PER_ERROR
    gaussian = np.array([0.5 + 0.5 * erf(error / sqrt(pi)) for error in errors])
    foot = 1 / (1 + np.exp(-errors / 2))
    distribution = np.rint((0.95 * gaussian + 0.05 * foot) * _WHOLE)
    logarithm = np.rint(UNIT * np.log(np.arange(_WHOLE + 1) + 2.0))
    return distribution.astype(np.int16), logarithm.astype(np.int16)


@inlined
def begin(experts: Experts, situation: int) -> None:
    """Take the scales of a situation; nothing is known of the number yet."""
    for k in range(len(experts.every)):
        if experts.means[k] != 0:
            scale = max(experts.scales[k, np.uint64(situation)], _LEAST_SCALE)
            experts.inverse[k] = _INVERSE // scale
        experts.lower[k], experts.upper[k] = 0, _WHOLE


@inlined
def ask(experts: Experts, edge: int, answers: Words) -> None:
    """Write each expert's logit for "the number is at least `edge`" (in 1 / FINE)."""
    asked, logits = experts.asked, experts.logits
    for k in range(len(experts.every)):
        place = ((edge - experts.means[k]) * experts.inverse[k]) >> 13
        place = min(max(place, -_REACH), _REACH) + _REACH
        asked[k] = experts.distribution[np.uint64(place)]
    for k in range(len(experts.every)):
        above, below = experts.upper[k] - asked[k], asked[k] - experts.lower[k]
        answer = int(logits[np.uint64(above)]) - int(logits[np.uint64(below)])
        answers[k] = answer if experts.means[k] != 0 else 0


@inlined
def tell(experts: Experts, bit: int) -> None:
    """The number is at least the edge that was asked for, or it is below: where it is now."""
    for k in range(len(experts.every)):
        lower, upper, asked = experts.lower[k], experts.upper[k], experts.asked[k]
        experts.lower[k] = asked if bit == 1 else lower
        experts.upper[k] = upper if bit == 1 else asked


@inlined
def learn(experts: Experts, situation: int, number: int, slow: int) -> None:
    """Let the scales learn from the number (in 1 / FINE)."""
    for k in range(len(experts.every)):
        if experts.means[k] != 0:
            wrong = min(abs(number - experts.means[k]), _FARTHEST) * 256
            place = np.uint64(situation)
            experts.scales[k, place] += (wrong - experts.scales[k, place]) >> slow

"""Experts, each of which predicts a number by a probability distribution.

The distribution gives probabilities of the binary decisions by which the number is coded. The mean
of the distribution is the expert's estimate. The scale is the mean absolute error of earlier
estimates in the same situation, i.e. in the same context.
"""

from __future__ import annotations

from functools import cache
from math import erf, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.binary_coder import LOGIT_UNIT
from pointkit.coding.context_mixing import Ints, Words
from pointkit.coding.intrinsics import Lanes
from pointkit.compiling import inlined

FINE = 16
"""Means and errors are in units of 1 / FINE."""
_ONE = 4096
"""Integer for probability 1."""
_REACH = 1024
"""Number of entries of the distribution's table on each side of the mean."""
_PER_ERROR = 128
"""Number of the table's entries per mean absolute error."""
_LEAST_SCALE = 2 * 256
_INVERSE = _PER_ERROR * 256 << 13
_MOST_ERROR = 4000
"""Larger errors are clipped to this before they change a scale."""


class Experts(NamedTuple):
    """State of the experts, whose distributions of the next number are mixed.

    Arrays are (experts,) unless noted.
    """

    means: Ints  # 0 for an expert without an estimate
    inverse: Ints  # of the scales
    lower: Ints  # cumulative distribution at the ends of the interval,
    upper: Ints
    edge: Ints  # and at the edge that divides it in the current decision
    scales: Words  # (experts, situations), mean absolute errors in 1 / (256 FINE)
    distribution: NDArray[np.int16]  # tables
    logits: NDArray[np.int16]
    every: Lanes  # a tuple whose length, the number of experts, is known to the compiler


def new_experts(scales: Words, count: int) -> Experts:
    """Return `count` experts with initial `scales`, which has a row for each expert."""
    means, inverse, lower, upper, edge = np.zeros((5, count), np.int64)
    return Experts(means, inverse, lower, upper, edge, scales, *_tables(), (0,) * count)


def first_scales(levels: int, first: int) -> Words:
    """Return scales (levels,) that double every two levels, from level `first` of `halves` on."""
    level = np.arange(levels) + first
    return np.asarray((1 << level // 2) * (2 + level % 2) * 128, np.int32)


@cache
def _tables() -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Return a cumulative distribution (Gaussian with wide tails), and a table of 256 ln(k + 2)."""
    errors = np.arange(-_REACH, _REACH + 1) / _PER_ERROR
    gaussian = np.array([0.5 + 0.5 * erf(error / sqrt(pi)) for error in errors])
    logistic = 1 / (1 + np.exp(-errors / 2))
    distribution = np.rint((0.95 * gaussian + 0.05 * logistic) * _ONE)
    logarithm = np.rint(LOGIT_UNIT * np.log(np.arange(_ONE + 1) + 2.0))
    return distribution.astype(np.int16), logarithm.astype(np.int16)


@inlined
def begin(experts: Experts, situation: int) -> None:
    """Load the experts' scales for `situation`, and allow all values of the next number."""
    for k in range(len(experts.every)):
        if experts.means[k] != 0:
            scale = max(experts.scales[k, np.uint64(situation)], _LEAST_SCALE)
            experts.inverse[k] = _INVERSE // scale
        experts.lower[k], experts.upper[k] = 0, _ONE


@inlined
def write_logits(experts: Experts, edge: int, answers: Words) -> None:
    """Write each expert's log odds that the number is at least `edge` / FINE to `answers`."""
    shares, logits = experts.edge, experts.logits
    for k in range(len(experts.every)):
        place = ((edge - experts.means[k]) * experts.inverse[k]) >> 13
        place = min(max(place, -_REACH), _REACH) + _REACH
        shares[k] = experts.distribution[np.uint64(place)]
    for k in range(len(experts.every)):
        above, below = experts.upper[k] - shares[k], shares[k] - experts.lower[k]
        answer = int(logits[np.uint64(above)]) - int(logits[np.uint64(below)])
        answers[k] = answer if experts.means[k] != 0 else 0


@inlined
def narrow(experts: Experts, bit: int) -> None:
    """Narrow the interval of the number to the part above (`bit` 1) or below the last edge."""
    for k in range(len(experts.every)):
        lower, upper, edge = experts.lower[k], experts.upper[k], experts.edge[k]
        experts.lower[k] = edge if bit == 1 else lower
        experts.upper[k] = upper if bit == 1 else edge


@inlined
def learn(experts: Experts, situation: int, number: int, slow: int) -> None:
    """Update each expert's scale in a situation by the error of the expert's estimate.

    Parameters
    ----------
    situation
        Column of the scales, i.e. the context in which the number was coded.
    number
        The number that was coded, in units of 1 / FINE.
    slow
        Log2 of the reciprocal of the learning rate.
    """
    for k in range(len(experts.every)):
        if experts.means[k] != 0:
            wrong = min(abs(number - experts.means[k]), _MOST_ERROR) * 256
            place = np.uint64(situation)
            experts.scales[k, place] += (wrong - experts.scales[k, place]) >> slow

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

from puckbench.codecs.common.binary_coder import UNIT
from puckbench.codecs.puck.mixing import Ints, Words
from puckbench.core.compiling import inlined

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

    means: (experts,), 0 for an expert that has none. inverse: (experts,), of the scales. edges:
    (experts, 2), the distribution at the ends of the interval. scales: (experts, situations), mean
    absolute errors in 1 / 256 of FINE. distribution, logits: tables. slow: shift of the average.
    """

    means: Ints
    inverse: Ints
    edges: Ints
    scales: Words
    distribution: Words
    logits: Words


def new_experts(scales: Words, count: int) -> Experts:
    """Experts with their first scales (scales, situations), of which there may be more."""
    zeros = np.zeros(count, np.int64)
    edges = np.zeros((count, 2), np.int64)
    return Experts(zeros, zeros.copy(), edges, scales, *_tables())


@cache
def _tables() -> tuple[Words, Words]:
    """Distribution of a number (Gaussian with a wide foot), and 256 times the logarithm."""
    errors = np.arange(-_REACH, _REACH + 1) / _PER_ERROR
    gaussian = np.array([0.5 + 0.5 * erf(error / sqrt(pi)) for error in errors])
    foot = 1 / (1 + np.exp(-errors / 2))
    distribution = np.rint((0.95 * gaussian + 0.05 * foot) * _WHOLE)
    logarithm = np.rint(UNIT * np.log(np.arange(_WHOLE + 1) + 2.0))
    return distribution.astype(np.int32), logarithm.astype(np.int32)


@inlined
def begin(experts: Experts, situation: int) -> None:
    """Take the scales of a situation; nothing is known of the number yet."""
    for k in range(len(experts.means)):
        if experts.means[k] != 0:
            experts.inverse[k] = _INVERSE // max(experts.scales[k, situation], _LEAST_SCALE)
        experts.edges[k, 0], experts.edges[k, 1] = 0, _WHOLE


@inlined
def ask(experts: Experts, edge: int, answers: Words) -> None:
    """Write each expert's logit for "the number is at least `edge`" (in 1 / FINE)."""
    for k in range(len(experts.means)):
        if experts.means[k] == 0:
            answers[k] = 0
        else:
            at = _at(experts, k, edge)
            upper, lower = experts.edges[k, 1] - at, at - experts.edges[k, 0]
            answers[k] = min(max(experts.logits[upper] - experts.logits[lower], -2047), 2047)


@inlined
def tell(experts: Experts, edge: int, bit: int) -> None:
    """The number is at least `edge`, or it is below: the interval is one part of it."""
    for k in range(len(experts.means)):
        if experts.means[k] != 0:
            experts.edges[k, 1 - bit] = _at(experts, k, edge)


@inlined
def learn(experts: Experts, situation: int, number: int, slow: int) -> None:
    """Let the scales learn from the number (in 1 / FINE)."""
    for k in range(len(experts.means)):
        if experts.means[k] != 0:
            wrong = min(abs(number - experts.means[k]), _FARTHEST) * 256
            experts.scales[k, situation] += (wrong - experts.scales[k, situation]) >> slow


@inlined
def _at(experts: Experts, k: int, edge: int) -> int:
    """The distribution of an expert below `edge`."""
    place = ((edge - experts.means[k]) * experts.inverse[k]) >> 13
    return int(experts.distribution[min(max(place, -_REACH), _REACH) + _REACH])

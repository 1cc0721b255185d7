"""Linear prediction by weighted least squares that forgets, in whole numbers.

The normal equations are sums of integers; one sweep of Gauss and Seidel now and then, from the
coefficients of before, keeps their solution. So every machine finds the same one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.coding.integer_vectors import as_vector, decay_and_add, dot, lanes_for
from puckbench.core.compiling import inlined
from puckbench.puck.mixing import Ints, Many, Words

FRACTION = 16
"""Coefficients are in units of 2**-FRACTION."""
_RIDGE = 5000
_LARGEST = 1 << 20
"""Coefficients are kept below this, so that no sum leaves 64 bits."""


class LeastSquares(NamedTuple):
    """State of predictors with the same features, each of which has its rows of a matrix.

    features: (lanes,), of the number that is to be predicted; zeros after the last one. products:
    (predictors * features, lanes), sums of the products of two features. targets, coefficients:
    (predictors, lanes), of a feature and the target. every, lanes: tuples, as long as there are
    features and lanes.
    """

    features: Words
    products: Words
    targets: Ints
    coefficients: Words
    every: Many
    lanes: Many


def new_least_squares(predictors: int, features: int) -> LeastSquares:
    """Predictors that predict 0."""
    lanes = lanes_for(features)
    products = np.zeros((predictors * features, len(lanes)), np.int32)
    targets = np.zeros((predictors, len(lanes)), np.int64)
    return LeastSquares(
        np.zeros(len(lanes), np.int32), products, targets, targets.astype(np.int32),
        (0,) * features, lanes,
    )  # fmt: skip


@inlined
def predicted(state: LeastSquares, which: int) -> int:
    """The prediction, in the features' unit."""
    start = which * len(state.lanes)
    as_vector(state.features, state.lanes)
    return int(dot(state.coefficients, start, state.features, 0, state.lanes) >> FRACTION)


@inlined
def learn_target(state: LeastSquares, which: int, target: int, damp: int, slow: int) -> None:
    """Take in an observation with weight 2**-damp; those before lose 2**-slow of theirs."""
    features, targets, lanes = state.features, state.targets, state.lanes
    first, predictor = which * len(state.every), np.uint64(which)
    for i in range(len(state.every)):
        one = features[i]
        targets[predictor, i] += ((one * target) >> damp) - (targets[predictor, i] >> slow)
        decay_and_add(state.products, (first + i) * len(lanes), features, one, damp, slow, lanes)


@inlined
def solve(state: LeastSquares, which: int) -> None:
    """One sweep of Gauss and Seidel."""
    products, coefficients, lanes = state.products, state.coefficients, state.lanes
    start, predictor = which * len(lanes), np.uint64(which)
    for i in range(len(state.every)):
        row = which * len(state.every) + i
        rest = state.targets[predictor, i] << FRACTION
        rest -= dot(products, row * len(lanes), coefficients, start, lanes)
        diagonal = np.int64(products[np.uint64(row), i])
        found = coefficients[predictor, i] + rest // (diagonal + _RIDGE)
        coefficients[predictor, i] = min(max(found, -_LARGEST), _LARGEST)

"""Linear prediction by weighted least squares that forgets, in whole numbers.

The normal equations are sums of integers; one sweep of Gauss and Seidel now and then, from the
coefficients of before, keeps their solution. So every machine finds the same one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.codecs.puck.mixing import Ints, Words
from puckbench.core.compiling import inlined

FRACTION = 16
"""Coefficients are in units of 2**-FRACTION."""
_RIDGE = 5000
_LARGEST = 1 << 20
"""Coefficients are kept below this, so that no sum leaves 64 bits."""


class LeastSquares(NamedTuple):
    """State of predictors with the same features: (predictors, features, ...).

    products: sums of the products of two features. targets: of a feature and the target.
    """

    products: Words
    targets: Ints
    coefficients: Ints


def new_least_squares(predictors: int, features: int) -> LeastSquares:
    """Predictors that predict 0."""
    products = np.zeros((predictors, features, features), np.int32)
    sums = np.zeros((2, predictors, features), np.int64)
    return LeastSquares(products, sums[0], sums[1])


@inlined
def predicted(state: LeastSquares, which: int, features: Ints) -> int:
    """The prediction, in the features' unit."""
    total = 0
    for i in range(len(features)):
        total += state.coefficients[which, i] * features[i]
    return total >> FRACTION


@inlined
def learn_target(
    state: LeastSquares, which: int, features: Ints, target: int, damp: int, slow: int
) -> None:
    """Take in an observation with weight 2**-damp; those before lose 2**-slow of theirs."""
    products, targets = state.products, state.targets
    for i in range(len(features)):
        one = np.int32(features[i])
        targets[which, i] += ((one * target) >> damp) - (targets[which, i] >> slow)
        for j in range(len(features)):
            products[which, i, j] += ((one * np.int32(features[j])) >> damp) - (
                products[which, i, j] >> slow
            )


@inlined
def solve(state: LeastSquares, which: int) -> None:
    """One sweep of Gauss and Seidel."""
    products, coefficients = state.products, state.coefficients
    width = coefficients.shape[1]
    for i in range(width):
        rest = state.targets[which, i] << FRACTION
        for j in range(width):
            rest -= np.int64(products[which, i, j]) * coefficients[which, j]
        found = coefficients[which, i] + rest // (np.int64(products[which, i, i]) + _RIDGE)
        coefficients[which, i] = min(max(found, -_LARGEST), _LARGEST)

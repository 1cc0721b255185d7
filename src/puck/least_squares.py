"""Linear prediction by recursive least squares with exponential forgetting, in integers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.context_mixing import Ints, Words
from pointkit.coding.intrinsics import Lanes, decay_and_add, dot, lanes_for
from pointkit.compiling import inlined

FRACTION = 16
"""Coefficients are in units of 2**-FRACTION."""
_RIDGE = 5000
_LARGEST = 1 << 20
"""Largest absolute value of a coefficient. Larger ones are clipped, so that sums fit in 64 bits."""


class LeastSquares(NamedTuple):
    """State of several linear predictors that share one vector of features."""

    features: Words  # (lanes,), then zeros
    products: Words  # (predictors * features * lanes,), sums of products of two features
    targets: Ints  # (predictors, lanes), weighted sums of a feature times the target
    coefficients: Words  # (predictors * lanes,)
    every: Lanes  # tuples whose lengths (features, lanes) are known to the compiler
    lanes: Lanes


def new_least_squares(predictors: int, features: int) -> LeastSquares:
    """Return `predictors` predictors with `features` coefficients each, all of them 0."""
    lanes = lanes_for(features)
    products = np.zeros(predictors * features * len(lanes), np.int32)
    targets = np.zeros((predictors, len(lanes)), np.int64)
    return LeastSquares(
        np.zeros(len(lanes), np.int32), products, targets,
        np.zeros(predictors * len(lanes), np.int32),
        (0,) * features, lanes,
    )  # fmt: skip


@inlined
def predicted(state: LeastSquares, which: int) -> int:
    """Return the number that predictor `which` predicts from the current features."""
    start = which * len(state.lanes)
    return int(dot(state.coefficients, start, state.features, 0, state.lanes) >> FRACTION)


@inlined
def learn_target(state: LeastSquares, which: int, target: int, damp: int, slow: int) -> None:
    """Add the current features and the number `target` to the sums of predictor `which`.

    The new observation has weight 2**-damp, and the weights of older observations are multiplied by
    1 - 2**-slow.
    """
    features, targets, lanes = state.features, state.targets, state.lanes
    first, predictor = which * len(state.every), np.uint64(which)
    for i in range(len(state.every)):
        feature = features[i]
        targets[predictor, i] += ((feature * target) >> damp) - (targets[predictor, i] >> slow)
        row = (first + i) * len(lanes)
        decay_and_add(state.products, row, features, feature, damp, slow, lanes)


@inlined
def solve(state: LeastSquares, which: int) -> None:
    """Improve the coefficients of predictor `which` by one Gauss-Seidel sweep."""
    products, coefficients, lanes = state.products, state.coefficients, state.lanes
    start, predictor = which * len(lanes), np.uint64(which)
    for i in range(len(state.every)):
        row = which * len(state.every) + i
        residual = state.targets[predictor, i] << FRACTION
        residual -= dot(products, row * len(lanes), coefficients, start, lanes)
        diagonal = np.int64(products[np.uint64(row * len(lanes) + i)])
        place = np.uint64(start + i)
        solution = coefficients[place] + residual // (diagonal + _RIDGE)
        coefficients[place] = min(max(solution, -_LARGEST), _LARGEST)

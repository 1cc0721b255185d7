"""Lifting transform, which predicts and updates the levels of detail in fixed-point arithmetic.

In TMC13: `PCCLiftPredict`, `PCCLiftUpdate`, `decodeReflectancesLift`, `decodeColorsLift`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.levels import Levels, divided, point_weights
from gpcc.attributes.neighbour_search import Predictors
from gpcc.attributes.quantisation import FRACTION_BITS, Quantisers, place_of, quantised
from gpcc.attributes.residuals import Coefficients
from gpcc.compiled import entry, integer
from gpcc.fixed_point import int32, inverse_square_root
from gpcc.spherical import halved_away
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints

_LOW_BITS = 20
_LOW_MASK = (1 << _LOW_BITS) - 1
_SUM_MASK = 0xFFFFFFFF


def lifting_weights(levels: Levels, scalable: bool) -> Ints:
    """Return the weights (n,) of the points, in coding order, that scale their coefficients."""
    if not scalable:
        return point_weights(levels.predictors, levels.predictors.weights)
    weights = np.full(len(levels.order), 1 << FRACTION_BITS, dtype=np.int64)
    start = 0
    for end in levels.ends[:-1]:
        weights[start:end] = len(weights) // end << FRACTION_BITS
        start = end
    return weights


@entry
def dequantise(
    coefficients: Coefficients,
    quantisers: Quantisers,
    order: NDArray[np.int32],
    ends: Ints,
    weights: Ints,
    last_component: Ints,
    transformed: Ints,
) -> None:
    """Compute the transformed values that quantised coefficients stand for.

    Parameters
    ----------
    coefficients
        Quantised coefficients (n, components).
    quantisers, order, ends, weights
        Step sizes; indices of the points in coding order; ends of the levels; weights of the
        points.
    last_component
        Factors (levels,), in units of 1/4, that predict the third component from the second.
    transformed
        Result (n, components), in units of 2^-FRACTION_BITS.
    """
    layer, level = integer(0), integer(0)
    components = coefficients.shape[1]
    for i in range(len(coefficients)):
        layer, level, region = place_of(i, layer, level, ends, quantisers, order)
        root = inverse_square_root(weights[i])
        scaled = integer(0)
        for k in range(components):
            value = integer(coefficients[i, k]) * quantisers.steps[layer, region, min(k, 1)]
            if k == 2:
                value += last_component[level] * scaled >> 2
            scaled = value
            transformed[i, k] = unweighted(scaled, root)


@inlined
def unweighted(scaled: int, root: int) -> int:
    """Return scaled * root / 2^40, rounded, without TMC13's overflow for 16-bit values."""
    size = abs(scaled)
    low = (size & _LOW_MASK) * root + (1 << 2 * _LOW_BITS >> 1)
    rounded = ((size >> _LOW_BITS) * root + (low >> _LOW_BITS)) >> _LOW_BITS
    return rounded if scaled >= 0 else -rounded


def transform(levels: Levels, weights: Ints, values: Ints, sign: int) -> None:
    """Transform values (n, components) in place; the sign is -1 for forward, 1 for the inverse."""
    sums = np.empty(len(weights), dtype=np.int64)
    updates = np.empty_like(values)
    parts = list(zip(levels.ends[:-1].tolist(), levels.ends[1:].tolist(), strict=True))
    for start, end in parts[::sign]:
        if sign < 0:
            _predict(levels.predictors, start, end, sign, values)
        _update(levels.predictors, weights, start, end, -sign, values, sums, updates)
        if sign > 0:
            _predict(levels.predictors, start, end, sign, values)


@entry
def _predict(predictors: Predictors, start: int, end: int, sign: int, values: Ints) -> None:
    for i in range(start, end):
        for k in range(values.shape[1]):
            total = integer(0)
            for n in range(predictors.counts[i]):
                total += predictors.weights[i, n] * values[predictors.neighbours[i, n], k]
            values[i, k] += sign * halved_away(total, FRACTION_BITS)


@entry
def _update(
    predictors: Predictors,
    weights: Ints,
    start: int,
    end: int,
    sign: int,
    values: Ints,
    sums: Ints,
    updates: Ints,
) -> None:
    for i in range(start):
        sums[i] = 0
        for k in range(values.shape[1]):
            updates[i, k] = 0
    for i in range(start, end):
        for n in range(predictors.counts[i]):
            neighbour = predictors.neighbours[i, n]
            weight = halved_away(predictors.weights[i, n] * weights[i], FRACTION_BITS)
            sums[neighbour] += weight
            for k in range(values.shape[1]):
                updates[neighbour, k] += weight * values[i, k]
    for i in range(start):
        total = sums[i] & _SUM_MASK
        if total:
            for k in range(values.shape[1]):
                values[i, k] += sign * divided(updates[i, k], total, 0)


@entry
def quantise(
    transformed: Ints,
    quantisers: Quantisers,
    order: NDArray[np.int32],
    ends: Ints,
    weights: Ints,
    last_component: Ints,
    coefficients: Coefficients,
) -> None:
    layer, level = integer(0), integer(0)
    for i in range(len(coefficients)):
        layer, level, region = place_of(i, layer, level, ends, quantisers, order)
        root = inverse_square_root(weights[i])
        weight = (weights[i] * root + (1 << 2 * _LOW_BITS - 1)) >> 2 * _LOW_BITS
        second = integer(0)
        for k in range(coefficients.shape[1]):
            value = transformed[i, k]
            if k == 2:
                value -= last_component[level] * second >> 2
            coefficient = quantised(
                value * weight, quantisers.reciprocals[layer, region, min(k, 1)]
            )
            coefficients[i, k] = coefficient
            if k == 1:
                second = unweighted(coefficient * quantisers.steps[layer, region, 1], root)


@entry
def choose_last_component(transformed: Ints, ends: Ints, factors: Ints) -> None:
    """Write the factors (levels,) of `dequantise` that suit transformed values (n, 3) to `factors`.

    As in TMC13, the factor of the last level before an empty one applies to all later levels.
    """
    start = integer(0)
    for level in range(len(ends)):
        if ends[level] == start:
            for unused in range(level, len(ends)):
                factors[unused] = factors[level - 1]
            return
        products, squares = integer(0), integer(0)
        for i in range(start, ends[level]):
            products += int32(transformed[i, 1] * transformed[i, 2])
            squares += int32(transformed[i, 1] * transformed[i, 1])
        factor = integer(0)
        if products and squares:
            sign = -1 if (products < 0) != (squares < 0) else 1
            numerator = (products << 2) + sign * (squares >> 1)
            factor = abs(numerator) // abs(squares)
            if (numerator < 0) != (squares < 0):
                factor = -factor
        factors[level] = min(max(factor, -8), 8)
        start = ends[level]

"""Predicting transform: each point's values are predicted from its neighbours' coded values.

In TMC13: `decodeReflectancesPred`, `decodeColorsPred`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import inlined
from puckbench.gpcc.attributes.neighbour_search import Ints, Predictors
from puckbench.gpcc.attributes.quantisation import FRACTION_BITS, Quantisers, halved_up
from puckbench.gpcc.attributes.residuals import Coefficients
from puckbench.gpcc.compiled import entry, integer
from puckbench.gpcc.spherical import halved_away

Values = NDArray[np.int32]


class PredictionTools(NamedTuple):
    """Tools of the predicting transform.

    ends: end of each level of detail in coding order.
    most: largest value.
    direct: number of neighbours whose value may be the prediction, and whether the average may not
        (0 or 1).
    threshold: least difference of neighbours' values at which the prediction is chosen.
    inter_component: (levels, 2) factors of the first component's residual, in quarters; empty
        if the other components do not use it.
    """

    ends: Ints
    most: int
    direct: int
    average_disabled: int
    threshold: int
    inter_component: Ints


@entry
def quantisation_weights(predictors: Predictors, shares: Ints, weights: Ints) -> None:
    """Write weights (n,) of residuals: larger for points that predict many others.

    shares: (3,) shares, in units of 2^-FRACTION_BITS, of a point's weight that its neighbours get.
    """
    for i in range(len(weights)):
        weights[i] = 1 << FRACTION_BITS
    for i in range(len(weights) - 1, -1, -1):
        for k in range(predictors.counts[i]):
            weights[predictors.neighbours[i, k]] += halved_away(
                shares[k] * weights[i], FRACTION_BITS
            )


@entry
def reconstruct(
    values: Values,
    coefficients: Coefficients,
    predictors: Predictors,
    tools: PredictionTools,
    quantisers: Quantisers,
    order: NDArray[np.int32],
    weights: Ints,
) -> None:
    """Write values (n, components) in coding order.

    order: see `levels.Levels`.
    weights: see `quantisation_weights`.
    """
    layer, level = integer(0), integer(0)
    components = values.shape[1]
    modes = tools.direct + 1 - tools.average_disabled
    for i in range(len(values)):
        if i == tools.ends[layer]:
            layer = min(len(quantisers.steps) - 1, layer + 1)
        if i == tools.ends[level]:
            level += 1
        region = integer(quantisers.region[order[i]]) if len(quantisers.region) else 0
        mode = integer(0)
        if is_mode_coded(values, predictors, tools, i):
            if components == 1:
                mode = _take_mode(coefficients, i, modes)
            else:
                mode = _take_mode_of_signs(coefficients, i, modes)
            mode += tools.average_disabled
        first_residual = integer(0)
        for k in range(components):
            step = quantisers.steps[layer, region, min(k, 1)]
            residual = scaled(integer(coefficients[i, k]), step, weights[i])
            value = predicted(values, predictors, i, k, mode) + residual
            if len(tools.inter_component):
                if k == 0:
                    first_residual = residual
                else:
                    value += (tools.inter_component[level, k - 1] * first_residual + 2) >> 2
            values[i, k] = min(max(value, 0), tools.most)


@inlined
def is_mode_coded(values: Values, predictors: Predictors, tools: PredictionTools, i: int) -> bool:
    """Return whether the neighbours' values differ so much that the prediction is chosen."""
    count = integer(predictors.counts[i])
    if count <= 1 or tools.direct == 0:
        return False
    for k in range(values.shape[1]):
        low = integer(values[predictors.neighbours[i, 0], k])
        high = low
        for n in range(1, count):
            value = integer(values[predictors.neighbours[i, n], k])
            low, high = min(low, value), max(high, value)
        if high - low >= tools.threshold:
            return True
    return False


@inlined
def predicted(values: Values, predictors: Predictors, i: int, k: int, mode: int) -> int:
    """Return the prediction of a component: neighbour `mode` from 1, or 0 the weighted average."""
    count = integer(predictors.counts[i])
    if mode > count:
        return 0
    if mode > 0:
        return integer(values[predictors.neighbours[i, mode - 1], k])
    total = integer(0)
    for n in range(count):
        total += predictors.weights[i, n] * integer(values[predictors.neighbours[i, n], k])
    return halved_up(total, FRACTION_BITS)


@inlined
def scaled(coefficient: int, step: int, weight: int) -> int:
    """Return the residual of a quantised one."""
    weight = max(min(weight, step) >> FRACTION_BITS, 1)
    residual = halved_up(coefficient * step, FRACTION_BITS)
    return residual // weight if residual >= 0 else -(-residual // weight)


@inlined
def _signed(magnitude: int, value: int) -> int:
    return -magnitude if value < 0 else magnitude


@inlined
def _take_mode(coefficients: Coefficients, i: int, modes: int) -> int:
    """Remove the mode from the low bits of a magnitude, and return it."""
    value = integer(coefficients[i, 0])
    magnitude = abs(value)
    mode = integer(0)
    if modes == 4:
        mode, magnitude = magnitude & 3, magnitude >> 2
    elif modes == 2 or modes == 3:  # noqa: PLR1714
        mode, magnitude = magnitude & 1, magnitude >> 1
        if modes == 3 and mode:
            mode, magnitude = mode + (magnitude & 1), magnitude >> 1
    coefficients[i, 0] = _signed(magnitude, value)
    return mode


@inlined
def _take_mode_of_signs(coefficients: Coefficients, i: int, modes: int) -> int:
    """Remove the mode from the lowest bits of the second and third magnitude, and return it."""
    second, third = integer(coefficients[i, 1]), integer(coefficients[i, 2])
    if modes < 2 or modes > 4:
        return 0
    mode = abs(second) & 1
    coefficients[i, 1] = _signed(abs(second) >> 1, second)
    if modes == 4 or (modes == 3 and mode):
        coefficients[i, 2] = _signed(abs(third) >> 1, third)
        mode = (2 * mode if modes == 4 else mode) + (abs(third) & 1)
    return mode

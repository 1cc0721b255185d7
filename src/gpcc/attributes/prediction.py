"""Predicting transform, which predicts each point's values from neighbours' coded values.

In TMC13: `decodeReflectancesPred`, `decodeColorsPred`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.colours import Values
from gpcc.attributes.neighbour_search import Predictors
from gpcc.attributes.quantisation import FRACTION_BITS, Quantisers, halved_up, place_of, quantised
from gpcc.attributes.residuals import Coefficients
from gpcc.compiled import entry, integer
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints

_SCALE = 1 << 20
_SCALE_LOG2 = 20
_WINDOW_LOG2 = 6
_LAMBDA = 0.14
"""Weight of bits against the distortion of colours."""


class PredictionTools(NamedTuple):
    """Parameters of the predicting transform."""

    # End of each level of detail in coding order.
    ends: Ints
    # Largest value.
    most: int
    # Number of neighbours whose value may be the prediction.
    direct: int
    # 1 if a coded mode cannot be the average.
    average_disabled: int
    # Least difference of neighbours' values at which a mode is coded.
    threshold: int
    # (levels, 2) factors, in units of 1/4, that predict the other components from the first
    # component's residual, or empty.
    inter_component: Ints


class Place(NamedTuple):
    """Index of a point in coding order, and its layer, region and level."""

    point: int
    layer: int
    region: int
    level: int


class Coding(NamedTuple):
    """Arrays that the predicting transform of a slice reads and writes."""

    # (n, components) in coding order: an encoder's input, replaced by the decoded values.
    values: Values
    # (n, components), which an encoder writes and a decoder reads.
    coefficients: Coefficients
    predictors: Predictors
    tools: PredictionTools
    quantisers: Quantisers
    # order, weights: (n,) index of each point in the slice, and weight of its residual.
    order: NDArray[np.int32]
    weights: Ints
    # (3, 2) working memory, in a decoder (0, 2): probabilities of residuals above 0 and above 1, in
    # units of 2^-20.
    greater: Ints


@entry
def code_values(coding: Coding) -> None:
    """Encode the values of a slice in coding order, or decode them if `coding.greater` is empty."""
    values, tools, greater = coding.values, coding.tools, coding.greater
    layer, level, encoding = integer(0), integer(0), len(greater) > 0
    for k in range(len(greater)):
        greater[k, 0] = greater[k, 1] = _SCALE >> 1
    for i in range(len(values)):
        layer, level, region = place_of(
            i, layer, level, tools.ends, coding.quantisers, coding.order
        )
        place = Place(i, layer, region, level)
        mode, is_coded = integer(0), is_mode_coded(values, coding.predictors, tools, i)
        if is_coded and not encoding:
            mode = _take_mode(coding.coefficients, i, tools)
        elif is_coded and values.shape[1] == 1:
            mode = _best_mode(coding, place)
        elif is_coded:
            mode = _best_colour_mode(coding, place)
        _code_point(coding, place, mode, encoding)
        if encoding and is_coded:
            _put_mode(coding.coefficients, i, tools, mode)
        if encoding:
            _count_residuals(coding.coefficients, i, greater)


@inlined
def _code_point(coding: Coding, place: Place, mode: int, encoding: bool) -> None:
    values, coefficients, tools = coding.values, coding.coefficients, coding.tools
    i, first_residual = place.point, integer(0)
    for k in range(values.shape[1]):
        step = coding.quantisers.steps[place.layer, place.region, min(k, 1)]
        prediction = predicted(values, coding.predictors, i, k, mode)
        if k and len(tools.inter_component):
            prediction += (tools.inter_component[place.level, k - 1] * first_residual + 2) >> 2
        weight = max(min(coding.weights[i], step) >> FRACTION_BITS, 1)
        if encoding:
            difference = (integer(values[i, k]) - prediction) * weight << FRACTION_BITS
            reciprocal = coding.quantisers.reciprocals[place.layer, place.region, min(k, 1)]
            coefficients[i, k] = quantised(difference, reciprocal)
        scaled = halved_up(integer(coefficients[i, k]) * step, FRACTION_BITS)
        residual = scaled // weight if scaled >= 0 else -(-scaled // weight)
        if k == 0:
            first_residual = residual
        values[i, k] = min(max(prediction + residual, 0), tools.most)


@inlined
def is_mode_coded(values: Values, predictors: Predictors, tools: PredictionTools, i: int) -> bool:
    """Return whether the neighbours' values differ so much that a prediction mode is coded."""
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
    """Return a predicted component: the average in mode 0, otherwise the value of one neighbour."""
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
def _signed(magnitude: int, value: int) -> int:
    return -magnitude if value < 0 else magnitude


@inlined
def _take_mode(coefficients: Coefficients, i: int, tools: PredictionTools) -> int:
    """Remove the mode from the low bits of the coefficients' magnitudes, and return the mode."""
    modes, last = tools.direct + 1 - tools.average_disabled, coefficients.shape[1] - 1
    mode = integer(0)
    if 2 <= modes <= 4:
        first, second = min(last, 1), last
        if modes == 4 and last == 0:
            mode = _take_bit(coefficients, i, 0)
            mode += 2 * _take_bit(coefficients, i, 0)
        elif modes == 4:
            mode = 2 * _take_bit(coefficients, i, first)
            mode += _take_bit(coefficients, i, second)
        else:
            mode = _take_bit(coefficients, i, first)
            if modes == 3 and mode:
                mode += _take_bit(coefficients, i, second)
    return mode + tools.average_disabled


@inlined
def _take_bit(coefficients: Coefficients, i: int, k: int) -> int:
    value = integer(coefficients[i, k])
    coefficients[i, k] = _signed(abs(value) >> 1, value)
    return abs(value) & 1


@inlined
def _put_mode(coefficients: Coefficients, i: int, tools: PredictionTools, mode: int) -> None:
    for k in range(coefficients.shape[1]):
        value = integer(coefficients[i, k])
        size = _with_mode(abs(value), tools, mode, k, coefficients.shape[1])
        coefficients[i, k] = _signed(size, value)


@inlined
def _with_mode(magnitude: int, tools: PredictionTools, mode: int, k: int, components: int) -> int:
    """Return a coefficient's magnitude with a mode's bits for component `k`, if any, appended."""
    modes, mode = tools.direct + 1 - tools.average_disabled, mode - tools.average_disabled
    if components == 1 and modes == 4:
        return 4 * magnitude + mode
    if modes == 4:
        return magnitude if k == 0 else 2 * magnitude + (mode >> 1 if k == 1 else mode & 1)
    if modes == 3 and mode and k == components - 1:
        magnitude = 2 * magnitude + mode - 1
    if 2 <= modes <= 3 and k == min(components - 1, 1):
        magnitude = 2 * magnitude + min(mode, 1)
    return magnitude


@inlined
def _count_residuals(coefficients: Coefficients, i: int, greater: Ints) -> None:
    for k in range(coefficients.shape[1]):
        size = abs(integer(coefficients[i, k]))
        for limit in range(1 + integer(size > 0)):
            if size > limit:
                greater[k, limit] += (_SCALE - greater[k, limit]) >> _WINDOW_LOG2
            else:
                greater[k, limit] -= greater[k, limit] >> _WINDOW_LOG2


@inlined
def _with_bits(bits: float, greater: Ints, k: int, size: int) -> float:
    """Return `bits` plus the estimated number of bits of a magnitude, added in TMC13's order."""
    if size == 0:
        return bits + (_SCALE_LOG2 - math.log2(_SCALE - greater[k, 0]))
    bits += _SCALE_LOG2 - math.log2(greater[k, 0])
    if size == 1:
        return bits + (_SCALE_LOG2 - math.log2(_SCALE - greater[k, 1])) + 1
    bits = bits + (_SCALE_LOG2 - math.log2(greater[k, 1])) + 1
    return bits + (2.0 * math.log2(size - 1.0) + 1.0)


@inlined
def _best_mode(coding: Coding, place: Place) -> int:
    values, predictors, tools = coding.values, coding.predictors, coding.tools
    reciprocal = coding.quantisers.reciprocals[place.layer, place.region, 0]
    best, least = integer(tools.average_disabled), integer(1 << 62)
    last = min(integer(predictors.counts[place.point]), tools.direct)
    for mode in range(tools.average_disabled, last + 1):
        prediction = predicted(values, predictors, place.point, 0, mode)
        difference = integer(values[place.point, 0]) - prediction
        size = abs(quantised(difference << FRACTION_BITS, reciprocal))
        size = _with_mode(size, tools, mode, 0, 1)
        score = integer(_with_bits(0.0, coding.greater, 0, size))
        if score < least:
            best, least = mode, score
    return best


@inlined
def _best_colour_mode(coding: Coding, place: Place) -> int:
    values, predictors, tools = coding.values, coding.predictors, coding.tools
    best, least = integer(tools.average_disabled), math.inf
    last = min(integer(predictors.counts[place.point]), tools.direct)
    for mode in range(tools.average_disabled, last + 1):
        distortion, bits, first_residual = integer(0), 0.0, integer(0)
        for k in range(3):
            step = coding.quantisers.steps[place.layer, place.region, min(k, 1)]
            reciprocal = coding.quantisers.reciprocals[place.layer, place.region, min(k, 1)]
            value = integer(values[place.point, k])
            prediction = predicted(values, predictors, place.point, k, mode)
            coefficient = quantised((value - prediction) << FRACTION_BITS, reciprocal)
            residual = halved_up(coefficient * step, FRACTION_BITS)
            distortion += abs(value - min(max(prediction + residual, 0), tools.most))
            if k == 0:
                first_residual = residual
            elif len(tools.inter_component):
                factor = tools.inter_component[place.level, k - 1]
                difference = value - prediction - ((factor * first_residual + 2) >> 2)
                coefficient = quantised(difference << FRACTION_BITS, reciprocal)
            size = _with_mode(abs(coefficient), tools, mode, k, 3)
            bits = _with_bits(bits, coding.greater, k, size)
        step = coding.quantisers.steps[place.layer, place.region, 0]
        score = distortion + bits * _LAMBDA * (step >> FRACTION_BITS)
        if score < least:
            best, least = mode, score
    return best


@entry
def choose_inter_component(
    values: Values, predictors: Predictors, ends: Ints, factors: Ints
) -> None:
    """Write the factors (levels, 2) of `PredictionTools.inter_component` that suit values (n, 3).

    As in TMC13, factors are 0 from the first empty level on.
    """
    start = integer(0)
    for level in range(len(ends)):
        if ends[level] == start:
            for unused in range(level, len(factors)):
                factors[unused, 0] = factors[unused, 1] = 0
            return
        for k in range(1, 3):
            best, least, without = integer(0), integer(-1), integer(0)
            for factor in range(1, 9):
                total = integer(0)
                without = 0
                for i in range(start, ends[level]):
                    first = integer(values[i, 0]) - predicted(values, predictors, i, 0, 1)
                    residual = integer(values[i, k]) - predicted(values, predictors, i, k, 1)
                    total += abs(residual - ((factor * first + 2) >> 2))
                    without += abs(residual)
                if least < 0 or total < least:
                    best, least = factor, total
            factors[level, k - 1] = 0 if least > without else best
        start = ends[level]

"""Levels of detail of a slice's points, and the neighbours that predict each point.

The coarsest level is coded first. In TMC13: `buildPredictorsFast`, `subsample`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.neighbour_search import (
    MEMORY,
    Atlas,
    Predictors,
    SearchOptions,
    SortedPoints,
    clear,
    holds_near_point,
    nearest_neighbours,
    set_cell,
    squared_distance,
)
from gpcc.attributes.quantisation import FRACTION_BITS
from gpcc.attributes.syntax import (
    BY_DISTANCE,
    PERIODIC,
    PREDICTING,
    AttributeHeader,
    AttributeParameterSet,
)
from gpcc.compiled import entry, integer, row
from gpcc.fixed_point import int32
from gpcc.kd_tree import Int32s
from gpcc.spherical import halved_away
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import inlined
from pointkit.errors import InputError
from pointkit.geometry.morton import Ints

_WORK_PER_POINT, _LEAST_WORK = 1 << 12, 1 << 30
_ONE = 1 << FRACTION_BITS
_INVERSES = np.rint(65536 / np.maximum(np.arange(257), 1)).astype(np.int64)
_FARTHEST = 1 << 29
_MOST_RANGE = 1 << 30


@dataclass(frozen=True)
class Levels:
    """Levels of detail of a slice.

    These are the coding order (n,) of the points, the end of each level in this order, and the
    predictors of the points.
    """

    order: Int32s
    ends: Ints
    predictors: Predictors


def levels_of_detail(
    points: SortedPoints,
    aps: AttributeParameterSet,
    header: AttributeHeader,
    bias: Ints,
) -> Levels:
    """Divide points into levels of detail, and find the neighbours that predict each point.

    Parameters
    ----------
    points
        The points of a slice, in Morton order unless `aps.canonical_point_order_flag` is set.
    aps, header
        Parameter set of the attribute, and header of the data unit.
    bias
        Factors (3,) of distances along the coded axes.

    Returns
    -------
    Levels
        The order of coding, the ends of the levels in it, and the neighbours with their weights.

    Raises
    ------
    InputError
        The factors are too large, or the search takes too long, as in some damaged streams.
    """
    if (points.positions.max(axis=0) * bias >= _FARTHEST).any():
        raise InputError("G-PCC: the factors of distances between points are too large")
    count = len(points.codes)
    predictors = Predictors(
        np.zeros(count, dtype=np.uint8),
        np.zeros((count, 3), dtype=np.int32),
        np.zeros((count, 3), dtype=np.int64),
    )
    order, ends = _build(points, aps, header, bias, predictors)
    coded = np.ascontiguousarray(order[::-1])
    _finish_predictors(
        predictors,
        order,
        np.empty(count, dtype=np.int32),
        points.positions,
        aps.attr_encoding == PREDICTING and bool(aps.pred_weight_blending_enabled_flag),
    )
    return Levels(points.indices[coded], np.array(ends[::-1], dtype=np.int64), predictors)


def _build(
    points: SortedPoints,
    aps: AttributeParameterSet,
    header: AttributeHeader,
    bias: Ints,
    predictors: Predictors,
) -> tuple[Int32s, list[int]]:
    count = len(points.codes)
    order = np.empty(count, dtype=np.int32)
    remaining = np.arange(count, dtype=np.int32)
    nothing = np.empty(0, dtype=np.int32)
    work = _LEAST_WORK + _WORK_PER_POINT * count
    ends, start, level = [count], 0, 0
    concatenates = bool(aps.scalable_lifting_enabled_flag)
    while len(remaining) and level < aps.max_detail_levels:
        taken, retained = remaining, nothing
        if level < aps.max_detail_levels - 1:
            taken, retained = _subsampled(points, aps, header, remaining, level)
        end = start + len(taken)
        order[start:end] = taken
        first = level
        if concatenates and len(taken):
            concatenates = len(taken) > start
            first = 0 if concatenates else level
        for again in range(first, level + 1):
            last = count - ends[again + 1] if again < level else end
            part = slice(count - ends[again], last)
            if part.start == part.stop:
                continue
            options = _search_options(aps, header, again)
            work = nearest_neighbours(
                points, options, bias, order, part, retained, predictors, work
            )
            if work < 0:
                raise InputError("G-PCC: the search of neighbours for attributes takes too long")
        if len(retained):
            ends.append(len(retained))
        start, remaining, level = end, retained, level + 1
    return order, ends


def _search_options(
    aps: AttributeParameterSet, header: AttributeHeader, level: int
) -> SearchOptions:
    scalable = bool(aps.scalable_lifting_enabled_flag)
    return SearchOptions(
        cell_bits=1 + level + (0 if scalable else aps.dist2 + header.attr_dist2_delta),
        inter_range=min(aps.inter_lod_search_range, _MOST_RANGE),
        intra=level >= aps.intra_lod_prediction_skip_layers,
        intra_range=min(aps.intra_lod_search_range, _MOST_RANGE),
        most=aps.num_pred_nearest_neighbours_minus1 + 1,
        mask_bits=level if scalable else 0,
        most_distance=3 * min(aps.max_neigh_range_minus1 + 1, 1 << 16) << 2 * level
        if scalable
        else -1,
    )


def _subsampled(
    points: SortedPoints,
    aps: AttributeParameterSet,
    header: AttributeHeader,
    remaining: Int32s,
    level: int,
) -> tuple[Int32s, Int32s]:
    dist2 = aps.dist2 + header.attr_dist2_delta + level
    is_retained = np.zeros(len(remaining), dtype=np.bool_)
    if aps.scalable_lifting_enabled_flag:
        _retain_centroids(points, remaining, level, level % 2 == 1, 0, is_retained)
    elif aps.lod_decimation_type == PERIODIC:
        is_retained[:: aps.lod_sampling_period[level]] = True
    elif aps.lod_decimation_type == BY_DISTANCE:
        _retain_distant(points, remaining, dist2, MEMORY.atlases[0], is_retained)
    else:
        period = aps.lod_sampling_period[level]
        _retain_centroids(points, remaining, dist2, True, period, is_retained)
    return remaining[~is_retained], remaining[is_retained]


@entry
def _retain_centroids(
    points: SortedPoints,
    remaining: Int32s,
    size_log2: int,
    backward: bool,
    period: int,
    is_retained: NDArray[np.bool_],
) -> None:
    """Retain the most central point in each run of nodes that hold at least `period` points."""
    # size_log2: log2 of half a node's side.
    # backward: whether to retain the last, not the first, of equally central points.
    count = len(remaining)
    if count == 1:
        return
    shift, mask = min(3 * (size_log2 + 1), 63), min(size_log2, 31)
    first = 0
    for i in range(count):
        last = i == count - 1
        if not last:
            same = (points.codes[remaining[i]] ^ points.codes[remaining[i + 1]]) >> shift == 0
            if same or i + 1 - first < period:
                continue
        x, y, z = integer(0), integer(0), integer(0)
        for k in range(first, i + 1):
            a, b, c = _node_corner(points.positions, remaining[k], mask)
            x, y, z = x + a, y + b, z + c
        best, least = integer(first), integer(1 << 62)
        for n in range(i + 1 - first):
            k = i - n if backward else first + n
            a, b, c = _node_corner(points.positions, remaining[k], mask)
            run = i + 1 - first
            distance = int32(
                abs(int32(a * run - x)) + abs(int32(b * run - y)) + abs(int32(c * run - z))
            )
            if distance < least:
                best, least = k, distance
        is_retained[best] = True
        first = i + 1


@inlined
def _node_corner(positions: Int32s, point: int, mask: int) -> tuple[int, int, int]:
    x, y, z = row(positions, point)
    return x >> mask << mask, y >> mask << mask, z >> mask << mask


@entry
def _retain_distant(
    points: SortedPoints,
    remaining: Int32s,
    distance_log2: int,
    atlas: Atlas,
    is_retained: NDArray[np.bool_],
) -> None:
    if len(remaining) == 1:
        return
    clear(atlas)
    shift = min(63, 3 * (distance_log2 + 1))
    block_shift = min(63, shift + 21)
    block, cell = integer(-1), integer(-1)
    for i in range(len(remaining)):
        point = integer(remaining[i])
        code = points.codes[point]
        if code >> block_shift != block:
            clear(atlas)
            block = code >> block_shift
        if i:
            if code >> shift == cell:
                continue
            radius2 = 3 << 2 * min(distance_log2, 30)
            if holds_near_point(points.positions, remaining, atlas, point, code >> shift, radius2):
                continue
        is_retained[i] = True
        cell = code >> shift
        set_cell(atlas, cell, i)


@entry
def _finish_predictors(
    predictors: Predictors, order: Int32s, place_of: Int32s, positions: Int32s, blend: bool
) -> None:
    """Replace neighbours by their places in coding order, and squared distances by weights."""
    counts, neighbours, weights = predictors
    for i in range(len(order)):
        place_of[order[i]] = len(order) - 1 - i
    for i in range(len(order)):
        count = integer(counts[i])
        if count > 1 and weights[i, 0] == 0:
            count = 1
        if count > 1:
            count = _normalise(weights, i, count)
        if count < 2:
            weights[i, 0] = _ONE
        elif count == 2:
            weights[i, 1] = divided(weights[i, 0], weights[i, 0] + weights[i, 1], FRACTION_BITS)
            weights[i, 0] = _ONE - weights[i, 1]
        else:
            _weight_triple(weights, i)
            if blend:
                _blend(neighbours, weights, i, positions)
        counts[i] = count
        for k in range(count):
            neighbours[i, k] = place_of[neighbours[i, k]]


def point_weights(predictors: Predictors, shares: Ints) -> Ints:
    """Return weights (n,) of points in coding order, larger for points that predict many others.

    Parameters
    ----------
    predictors
        The neighbours that predict each point.
    shares
        Shares of a point's weight that its neighbours get, in units of 2^-FRACTION_BITS; (n, 3), or
        (1, 3) for all points.
    """
    weights = np.full(len(predictors.counts), _ONE, dtype=np.int64)
    _add_weights(predictors, shares, weights)
    return weights


@entry
def _add_weights(predictors: Predictors, shares: Ints, weights: Ints) -> None:
    for i in range(len(weights) - 1, -1, -1):
        row = min(i, len(shares) - 1)
        for k in range(predictors.counts[i]):
            share = halved_away(shares[row, k] * weights[i], FRACTION_BITS)
            weights[predictors.neighbours[i, k]] += share


@inlined
def _normalise(weights: Ints, i: int, count: int) -> int:
    """Shift the squared distances of point i right until the first fits in FRACTION_BITS bits."""
    # Return how many of the `count` distances are below 2^FRACTION_BITS times the first.
    shift = max(64 - leading_zeros(weights[i, 0]) - FRACTION_BITS, 0)
    for k in range(count):
        weights[i, k] = (weights[i, k] + (1 << shift >> 1)) >> shift
    while count > 1 and weights[i, count - 1] >= weights[i, 0] << FRACTION_BITS:
        count -= 1
    return count


@inlined
def _weight_triple(weights: Ints, i: int) -> None:
    a, b, c = weights[i, 0], weights[i, 1], weights[i, 2]
    total = b * c + a * c + a * b
    weights[i, 2] = divided(a * b, total, FRACTION_BITS)
    weights[i, 1] = divided(a * c, total, FRACTION_BITS)
    weights[i, 0] = _ONE - weights[i, 1] - weights[i, 2]


@inlined
def _blend(neighbours: Int32s, weights: Ints, i: int, positions: Int32s) -> None:
    """Move 1/16 of each neighbour's weight to the nearer, 5/16 to the farther of the two others."""
    a, b, c = neighbours[i, 0], neighbours[i, 1], neighbours[i, 2]
    ab, ac = squared_distance(positions, a, b), squared_distance(positions, a, c)
    bc = squared_distance(positions, b, c)
    first, second, third = 1 if ab <= ac else 5, 5 if ab <= bc else 1, 1 if ac <= bc else 5
    w0, w1, w2 = weights[i, 0], weights[i, 1], weights[i, 2]
    weights[i, 0] = (w0 * 10 + w1 * (6 - second) + w2 * third) >> 4
    weights[i, 1] = (w0 * first + w1 * 10 + w2 * (6 - third)) >> 4
    weights[i, 2] = _ONE - weights[i, 0] - weights[i, 1]


@inlined
def divided(numerator: int, denominator: int, fraction_bits: int) -> int:
    """Return a number divided by a positive number, approximately (`divApprox` in TMC13)."""
    shift = max(64 - leading_zeros(denominator) - 8, 0)
    inverse = _INVERSES[(denominator + (1 << shift >> 1)) >> shift]
    quotient: int = numerator * inverse >> shift + 16 - fraction_bits
    return quotient

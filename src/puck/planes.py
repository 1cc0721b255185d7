"""Segmentation of a range image into planes.

Each row of the image is cut into short pieces, i.e. runs of returns on one line. Pieces are merged
to larger sets of returns as long as one plane fits both.

A return at range r of a beam with origin o and direction d is the point p = r d + o. A plane is the
set of points p with m . p = 1; multiplied by r, this is r = (r p) . m. A least squares fit of m
needs 11 sums over a set's returns; when two sets are merged, their sums are added.

References
----------
Jiang and Bunke 1994, "Fast segmentation of range images into planar regions by scan line grouping";
Feng, Taguchi and Kamat 2014, "Fast plane extraction in organized point clouds using agglomerative
hierarchical clustering".
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled_in_place, inlined
from pointkit.geometry.cloud import Floats

Labels = NDArray[np.int32]
Places = NDArray[np.int64]

_SUMS = 11
"""Sums over a set of returns: 1, six products of components of r p, three of r p and r, and r^2."""
_LONGEST_PIECE = 8
_GAP = 3
"""Returns in a row are neighbours if they are at most this number of columns apart."""
_STEEPEST = 6.0
"""Neighbours form an edge of a surface if the incidence angle has a larger tangent."""
_JUMP = 4.0
"""Number of standard deviations by which neighbours may differ more than `_STEEPEST` allows."""
_SLOPE = 2.0
"""Tangent of a typical incidence angle, the prior for slopes that returns do not determine."""
_GAINS = (2.0, 8.0, 25.0)
"""Multiples of the noise variance by which a merger may increase the sum of squared errors, in
successive rounds."""
_ROUNDS = 3
_BORDER = 6
"""A border between planes moves by at most this number of returns."""
_FULL_WEIGHT, _ANY_WEIGHT, _MOST_COST = 4.0, 25.0, 9.0
"""Squared errors, in noise variances: a return has weight 1 up to the first, and weight 0 above the
second; the third limits a return's cost when borders move."""

_loop = partial(compiled_in_place, error_model="numpy")


class RangeRows(NamedTuple):
    """A range image, with lasers from lowest to highest.

    `ranges` (lasers, columns), in metres, are 0 for no return; `rows` (lasers, columns, 3) are
    points times their ranges, as in the equation ``range = row . m`` of a plane m.
    """

    ranges: Floats
    rows: Floats


class LabelledPlanes(NamedTuple):
    """Planes that were fitted to a range image, and each return's plane.

    `labels` (lasers, columns) are indices of planes, or -1 for a return without a plane; the second
    field holds the vectors m (n, 3) of the planes.
    """

    labels: Labels
    vectors: Floats


def fitted_planes(
    image: RangeRows, column: float, std: float, tolerance: float, closes: bool
) -> LabelledPlanes:
    """Assign each return of a range image to a plane, and fit the planes.

    Parameters
    ----------
    image
        The range image.
    column
        Angle between adjacent columns, in radians.
    std
        Standard deviation of a range, in metres.
    tolerance
        Two sets of returns are merged if their mean squared distance to a common plane, beyond the
        part due to noise, is at most this number of noise variances.
    closes
        Whether the image is a full turn, so that the last column is next to the first.

    Returns
    -------
    LabelledPlanes
        The index of each return's plane, and the planes.
    """
    ranges, variance = image.ranges, std * std
    labels = np.full(ranges.shape, -1, np.int32)
    scratch = np.zeros((2, _SUMS)), np.zeros(3)
    sums = np.zeros((np.count_nonzero(ranges > 0), _SUMS))
    places = np.zeros(_LONGEST_PIECE, np.int64)
    pieces = _cut(image, column, std, labels, sums, scratch, places)
    sums = sums[:pieces]
    within = np.zeros((pieces + len(ranges), 2), np.int32)
    across = np.zeros((2 * pieces + 1, 2), np.int32)
    counts = _pairs(labels, closes, within, across)
    within, across = within[: counts[0]], across[: counts[1]]
    parents, squares = np.arange(pieces, dtype=np.int32), np.zeros(pieces)
    _measure(sums, squares, variance, scratch[1])
    _merge(within, parents, sums, squares, variance, min(tolerance, 0.5), scratch)
    both = np.concatenate([across, within])
    _merge(both, parents, sums, squares, variance, tolerance, scratch)
    count = _number_sets(labels, parents)
    planes, sums = np.zeros((count, 3)), np.zeros((count, _SUMS))
    for weighted in (False, True):
        _fit(image, labels, planes, sums, variance, weighted)
    _move_borders(image, labels, planes, variance)
    _fit(image, labels, planes, sums, variance, True)
    return LabelledPlanes(labels, planes)


@inlined
def _add(sums: Floats, row: Floats, target: float, weight: float) -> None:
    sums[0] += weight
    sums[1] += weight * row[0] * row[0]
    sums[2] += weight * row[0] * row[1]
    sums[3] += weight * row[0] * row[2]
    sums[4] += weight * row[1] * row[1]
    sums[5] += weight * row[1] * row[2]
    sums[6] += weight * row[2] * row[2]
    sums[7] += weight * row[0] * target
    sums[8] += weight * row[1] * target
    sums[9] += weight * row[2] * target
    sums[10] += weight * target * target


@inlined
def _solve(sums: Floats, variance: float, plane: Floats) -> float:
    """Fit a plane by Cholesky's method, write it to `plane`, and return the sum of squared errors.

    A small diagonal term keeps undetermined slopes near zero.
    """
    ridge = variance * sums[10] / max(sums[0], 1.0) / (_SLOPE * _SLOPE)
    ridge += 1e-12 * (sums[1] + sums[4] + sums[6])
    l00 = np.sqrt(sums[1] + ridge)
    l10, l20 = sums[2] / l00, sums[3] / l00
    l11 = np.sqrt(max(sums[4] + ridge - l10 * l10, ridge))
    l21 = (sums[5] - l20 * l10) / l11
    l22 = np.sqrt(max(sums[6] + ridge - l20 * l20 - l21 * l21, ridge))
    y0 = sums[7] / l00
    y1 = (sums[8] - l10 * y0) / l11
    y2 = (sums[9] - l20 * y0 - l21 * y1) / l22
    plane[2] = y2 / l22
    plane[1] = (y1 - l21 * plane[2]) / l11
    plane[0] = (y0 - l10 * plane[1] - l20 * plane[2]) / l00
    squares: float = max(sums[10] - y0 * y0 - y1 * y1 - y2 * y2, 0.0)
    return squares


@inlined
def range_error(row: Floats, target: float, plane: Floats) -> float:
    """Return the signed distance in metres, along the beam, from a return to a plane."""
    error: float = target - row[0] * plane[0] - row[1] * plane[1] - row[2] * plane[2]
    return error


@_loop
def _cut(
    image: RangeRows, column: float, std: float, labels: Labels, sums: Floats,
    scratch: tuple[Floats, Floats], places: Places,
) -> int:  # fmt: skip
    """Cut rows into pieces, write each return's piece to `labels`, and return the number of pieces.

    A piece ends at a jump or a gap, or where two lines fit its returns far better than one.
    """
    ranges, rows = image
    count = 0
    for laser in range(ranges.shape[0]):
        start = 0
        while start < ranges.shape[1]:
            if ranges[laser, start] <= 0:
                start += 1
                continue
            length = _reached(ranges[laser], start, column, std, places)
            length = _first_part(image, laser, length, std * std, scratch, places)
            for i in range(length):
                labels[laser, places[i]] = count
                _add(sums[count], rows[laser, places[i]], ranges[laser, places[i]], 1.0)
            count += 1
            start = places[length - 1] + 1
    return count


@inlined
def _reached(ranges: Floats, start: int, column: float, std: float, places: Places) -> int:
    places[0] = before = start
    length, at = 1, start + 1
    while at < len(ranges) and length < _LONGEST_PIECE and at - before < _GAP:
        near, far = ranges[before], ranges[at]
        if far > 0:
            slope = _STEEPEST * column * (at - before) * min(near, far)
            if abs(far - near) > _JUMP * std + slope:
                break
            places[length] = before = at
            length += 1
        at += 1
    return length


@inlined
def _first_part(
    image: RangeRows, laser: int, length: int, variance: float, scratch: tuple[Floats, Floats],
    places: Places,
) -> int:  # fmt: skip
    """Return the length of the first line if two lines fit far better than one, else `length`."""
    ranges, rows = image.ranges[laser], image.rows[laser]
    both, plane = scratch
    first, second = both[0], both[1]
    second[:] = 0
    for i in range(length):
        _add(second, rows[places[i]], ranges[places[i]], 1.0)
    whole = _solve(second, variance, plane)
    if length < 4 or whole <= 1.5 * (length + 6) * variance:
        return length
    best, end = whole / 2, length
    first[:] = 0
    for i in range(length - 2):
        _add(first, rows[places[i]], ranges[places[i]], 1.0)
        _add(second, rows[places[i]], ranges[places[i]], -1.0)
        if i > 0:
            apart = _solve(first, variance, plane) + _solve(second, variance, plane)
            if apart < best:
                best, end = apart, i + 1
    return end


@_loop
def _pairs(labels: Labels, closes: bool, within: Labels, across: Labels) -> tuple[int, int]:
    lasers, columns = labels.shape
    beside = above = 0
    for laser in range(lasers):
        first, last, before = -1, -1, 0
        for column in range(columns):
            piece = labels[laser, column]
            if piece < 0:
                continue
            if first < 0:
                first = piece
            elif piece != last and column - before <= _GAP:
                within[beside, 0], within[beside, 1] = last, piece
                beside += 1
            last, before = piece, column
        if closes and first != last:
            within[beside, 0], within[beside, 1] = last, first
            beside += 1
    for laser in range(lasers - 1):
        low = high = -1
        for column in range(columns):
            lower, upper = labels[laser, column], labels[laser + 1, column]
            if lower >= 0 and upper >= 0 and (lower != low or upper != high):
                low, high = lower, upper
                across[above, 0], across[above, 1] = lower, upper
                above += 1
    return beside, above


@_loop
def _measure(sums: Floats, squares: Floats, variance: float, plane: Floats) -> None:
    for k in range(len(sums)):
        squares[k] = _solve(sums[k], variance, plane)


@inlined
def _root(parents: Labels, piece: int) -> int:
    while parents[piece] != piece:
        parents[piece] = parents[parents[piece]]
        piece = parents[piece]
    return piece


@_loop
def _merge(
    pairs: Labels, parents: Labels, sums: Floats, squares: Floats, variance: float,
    tolerance: float, scratch: tuple[Floats, Floats],
) -> None:  # fmt: skip
    both, plane = scratch
    total = both[0]
    for gain in _GAINS:
        for _ in range(_ROUNDS):
            merged, low, high = False, -1, -1
            for pair in range(len(pairs)):
                left, right = _root(parents, pairs[pair, 0]), _root(parents, pairs[pair, 1])
                if left == right or (left == low and right == high):
                    continue
                low, high = left, right
                for i in range(_SUMS):
                    total[i] = sums[left, i] + sums[right, i]
                whole = _solve(total, variance, plane)
                apart = sums[left, 0] * sums[right, 0] / total[0]
                if whole - squares[left] - squares[right] <= variance * (gain + tolerance * apart):
                    kept, gone = min(left, right), max(left, right)
                    parents[gone] = kept
                    for i in range(_SUMS):
                        sums[kept, i] = total[i]
                    squares[kept] = whole
                    merged, low = True, -1
            if not merged:
                break


@_loop
def _number_sets(labels: Labels, parents: Labels) -> int:
    count = 0
    for piece in range(len(parents)):
        parents[piece] = _root(parents, piece)
    for piece in range(len(parents)):  # a set's root is the first of its pieces
        if parents[piece] == piece:
            parents[piece] = count
            count += 1
        else:
            parents[piece] = parents[parents[piece]]
    for laser in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            if labels[laser, column] >= 0:
                labels[laser, column] = parents[labels[laser, column]]
    return count


@_loop
def _fit(
    image: RangeRows, labels: Labels, planes: Floats, sums: Floats, variance: float, weighted: bool
) -> None:
    """Fit a plane to each set; if `weighted`, returns far from the current plane count less."""
    ranges, rows = image
    sums[:] = 0
    for laser in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            plane = labels[laser, column]
            if plane < 0:
                continue
            weight = 1.0
            if weighted:
                error = range_error(rows[laser, column], ranges[laser, column], planes[plane])
                square = error * error / variance
                if square > _FULL_WEIGHT:
                    weight = np.sqrt(_FULL_WEIGHT / square) if square < _ANY_WEIGHT else 0.0
            _add(sums[plane], rows[laser, column], ranges[laser, column], weight)
    for plane in range(len(planes)):
        _solve(sums[plane], variance, planes[plane])


@_loop
def _move_borders(image: RangeRows, labels: Labels, planes: Floats, variance: float) -> None:
    for laser in range(len(labels)):
        row, before = labels[laser], -1
        for column in range(len(row)):
            if row[column] < 0:
                continue
            if before >= 0 and row[before] != row[column] and column - before <= _GAP:
                left, right = row[before], row[column]
                low, high = _last_of(row, before, -1), _last_of(row, column, 1)
                border = _border(image, laser, planes[left], planes[right], low, high, variance)
                for at in range(low, high + 1):
                    if row[at] >= 0:
                        row[at] = left if at < border else right
            before = column


@inlined
def _last_of(labels: Labels, start: int, step: int) -> int:
    last, count, at = start, 0, start
    while 0 <= at < len(labels) and count < _BORDER:
        if labels[at] == labels[start]:
            last, count = at, count + 1
        elif labels[at] >= 0:
            break
        at += step
    return last


@inlined
def _border(
    image: RangeRows, laser: int, left: Floats, right: Floats, low: int, high: int, variance: float
) -> int:
    ranges, rows = image.ranges[laser], image.rows[laser]
    cost, best, border = 0.0, 0.0, low
    for at in range(low, high + 1):
        if ranges[at] > 0:
            left_error = range_error(rows[at], ranges[at], left)
            right_error = range_error(rows[at], ranges[at], right)
            left_cost = min(left_error * left_error / variance, _MOST_COST)
            cost += left_cost - min(right_error * right_error / variance, _MOST_COST)
            if cost < best:
                best, border = cost, at + 1
    return border

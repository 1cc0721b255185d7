"""Attributes of moved or merged points, computed from the attributes of source points.

In TMC13: `recolourColour`, `recolourReflectance`, with their default parameters.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.colours import Values
from gpcc.compiled import entry, integer
from gpcc.kd_tree import KdTrees, build, empty_trees, search
from pointkit.compiling import inlined
from pointkit.geometry.cloud import Floats
from pointkit.geometry.morton import Ints

_NEIGHBOURS = 8
_SAME = 0.0001
_NEARLY_ONE = 1 - 0.00001
_DISTANCE_OFFSET = 4.0


class Source(NamedTuple):
    """Source points (n, 3), whose positions in the coded cloud are points * scale - offset."""

    points: Floats
    scale: float
    offset: Floats


def recoloured(positions: NDArray[np.int32], values: Values, source: Source, most: int) -> Values:
    """Return the attribute values of merged points, from the values of the points before merging.

    Two errors matter: the difference from the average of the nearest source points, and the
    difference from all source points to which the merged point is nearest. Each value minimises the
    larger of the two.

    Parameters
    ----------
    positions
        Coordinates (m, 3) of the merged points in the coded cloud.
    values
        Values (n, components) of the source points.
    source
        The source points.
    most
        Largest value.

    Returns
    -------
    ndarray
        Values (m, components).
    """
    target = positions.astype(np.float64)
    averages = np.empty((len(target), values.shape[1]), dtype=np.int32)
    in_source = (target + source.offset) * (1.0 / source.scale)
    # Where there are fewer points, TMC13 averages what earlier searches left in the results.
    _average_nearest(*_tree(source.points, _NEIGHBOURS), in_source, values, most, averages)
    owner, squares = np.empty(len(values), dtype=np.int64), np.empty(len(values))
    in_target = source.points * source.scale - source.offset
    _find_owners(*_tree(target, 1), in_target, owner, squares)
    order = np.lexsort((squares, owner))
    starts = np.searchsorted(owner[order], np.arange(len(target) + 1))
    result = averages.copy()
    _refine(values[order], squares[order], starts, most, averages, result)
    return result


def _tree(points: Floats, neighbours: int) -> tuple[KdTrees, Floats]:
    count, box = len(points), np.empty(6)
    trees = empty_trees(np.float64, count, neighbours)
    trees.places[:], trees.rows[:] = points.T, np.arange(count)
    build(trees, 0, count, box, _NEARLY_ONE)
    return trees, box


@entry
def _average_nearest(
    trees: KdTrees, box: Floats, places: Floats, values: Values, most: int, averages: Values
) -> None:
    rows, squares = trees.nearest, trees.distances
    for i in range(len(places)):
        squares[_NEIGHBOURS - 1] = math.inf
        search(trees, 0, box, (places[i, 0], places[i, 1], places[i, 2]), 0)
        for c in range(values.shape[1]):
            if squares[0] < _SAME:
                averages[i, c] = values[rows[0], c]
                continue
            total, weights = 0.0, 0.0
            for k in range(_NEIGHBOURS):
                weight = 1 / (squares[k] + _DISTANCE_OFFSET)
                total += values[rows[k], c] * weight
                weights += weight
            averages[i, c] = _rounded(total / weights, most)


@inlined
def _rounded(value: float, most: int) -> int:
    whole = math.floor(value)
    return integer(min(max(whole + (1 if value - whole >= 0.5 else 0), 0), most))


@entry
def _find_owners(trees: KdTrees, box: Floats, places: Floats, owner: Ints, squares: Floats) -> None:
    for i in range(len(places)):
        trees.distances[0] = math.inf
        search(trees, 0, box, (places[i, 0], places[i, 1], places[i, 2]), 0)
        owner[i], squares[i] = trees.nearest[0], trees.distances[0]


@entry
def _refine(
    values: Values, squares: Floats, starts: Ints, most: int, averages: Values, result: Values
) -> None:
    components = values.shape[1]
    source_share, target_share = 1.0 / len(values), 1.0 / len(averages)
    choices = 27 if components == 3 else 3
    for i in range(len(averages)):
        first, last = starts[i], starts[i + 1]
        if first == last:
            continue
        least = math.inf
        a = _centre(values, squares, first, last, 0, most)
        b = _centre(values, squares, first, last, 1, most) if components == 3 else 0
        c = _centre(values, squares, first, last, 2, most) if components == 3 else 0
        for choice in range(choices):
            if components == 3:
                tried = (
                    min(max(a + choice // 9 - 1, 0), most),
                    min(max(b + choice // 3 % 3 - 1, 0), most),
                    min(max(c + choice % 3 - 1, 0), most),
                )
            else:
                tried = (min(max(a + choice - 1, 0), most), integer(0), integer(0))
            target_error, source_error = integer(0), integer(0)
            for k in range(components):
                target_error += (tried[k] - averages[i, k]) ** 2
                for n in range(first, last):
                    source_error += (tried[k] - values[n, k]) ** 2
            error = max(target_error * target_share, source_error * source_share)
            if error < least:
                least = error
                for k in range(components):
                    result[i, k] = tried[k]


@inlined
def _centre(values: Values, squares: Floats, first: int, last: int, k: int, most: int) -> int:
    if last - first == 1:
        return integer(values[first, k])
    total, weights = 0.0, 0.0
    for n in range(first, last):
        weight = 1 / (math.sqrt(squares[n]) + _DISTANCE_OFFSET)
        total += values[n, k] * weight
        weights += weight
    return _rounded(total / weights, most)

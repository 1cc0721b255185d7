"""Search of the three nearest neighbours of points in a level of detail.

Candidates are points of coarser levels, first those in the same and in adjacent cells, and points
of the same level that are coded before. In TMC13: `computeNearestNeighbors`, `BoxHierarchy`,
`MortonIndexMap3d`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import inlined
from puckbench.geometry.morton import X_BITS, Y_BITS, Z_BITS
from puckbench.gpcc.compiled import entry, integer

Ints = NDArray[np.int64]
Indices = NDArray[np.int32]
Positions = NDArray[np.int32]
Best = tuple[int, int, int, int, int, int]

_CELL_BITS = 21
_CELLS = 1 << _CELL_BITS
_FAR = 1 << 62
_NEAR_RANGE = 2
_FAN_LOG2 = 3
_FAN_MASK = 7

# Neighbours of a cell in the order of the search, as Morton codes of offsets from the lowest.
ALL_NEIGHBOURS = np.array(
    [
        *(7, 3, 5, 6, 35, 21, 14, 28, 42, 49, 12, 10, 17, 20, 34, 33, 4, 2, 1),
        *(56, 24, 40, 48, 32, 16, 8, 0),
    ],
    dtype=np.int64,
)


# Those that can precede a cell in Morton order.
PRECEDING_NEIGHBOURS = np.array(
    [7, 3, 5, 6, 12, 10, 17, 20, 34, 33, 4, 2, 1, 24, 40, 48, 32, 16, 8, 0], dtype=np.int64
)


class Atlas(NamedTuple):
    """Grid of 128^3 cells: first and last + 1 of the points in each; `used` cells, and their
    number `filled`."""

    cells: Indices
    used: Indices
    filled: Ints


class SortedPoints(NamedTuple):
    """Points in Morton order: codes (n,), positions (n, 3), and indices (n,) of the points."""

    codes: Ints
    positions: Positions
    indices: Indices


class SearchOptions(NamedTuple):
    """Options of a level.

    cell_bits: log2 of the cells' side.
    inter_range, intra_range: how many candidates before and after are searched, in coarser levels
        and in the same.
    most: number of neighbours.
    mask_bits: lowest bits of coordinates that are ignored.
    most_distance: squared distance beyond which only the nearest neighbour is used, or -1.
    """

    cell_bits: int
    inter_range: int
    intra: bool
    intra_range: int
    most: int
    mask_bits: int
    most_distance: int


class Boxes(NamedTuple):
    """Positions (n, 3), and bounding boxes of 8, 64, 512, ... successive ones.

    boxes: (m, 6), those of 8 positions first.
    starts: first box of each size; index 0 is not used.
    """

    positions: Positions
    boxes: Positions
    starts: Ints


def empty_atlas() -> Atlas:
    return Atlas(
        np.full((_CELLS, 2), -1, dtype=np.int32),
        np.empty(_CELLS, dtype=np.int32),
        np.zeros(1, dtype=np.int64),
    )


@inlined
def neighbour_code(code: int, offset: int) -> int:
    """Return the Morton code of a cell at an offset of -1 to 1 along each axis; wraps around."""
    return (
        _moved(code, offset, X_BITS, 4)
        | _moved(code, offset, Y_BITS, 2)
        | _moved(code, offset, Z_BITS, 1)
    )


@inlined
def _moved(code: int, offset: int, axis_bits: int, lowest: int) -> int:
    lower = (code & axis_bits) - lowest
    return ((lower & axis_bits | ~axis_bits) + (offset & axis_bits)) & axis_bits


@inlined
def set_cell(atlas: Atlas, code: int, index: int) -> None:
    cell = code & (_CELLS - 1)
    if atlas.cells[cell, 0] < 0:
        atlas.cells[cell, 0] = index
        atlas.used[atlas.filled[0]] = cell
        atlas.filled[0] += 1
    atlas.cells[cell, 1] = index + 1


@inlined
def clear(atlas: Atlas) -> None:
    for k in range(atlas.filled[0]):
        atlas.cells[atlas.used[k], 0] = -1
        atlas.cells[atlas.used[k], 1] = -1
    atlas.filled[0] = 0


@inlined
def holds_near_point(
    positions: Positions, indices: Indices, atlas: Atlas, point: int, cell: int, radius2: int
) -> bool:
    """Return whether a point of preceding cells is within a radius, given squared, of `point`."""
    for offset in PRECEDING_NEIGHBOURS:
        other = neighbour_code(cell, offset)
        if other >> _CELL_BITS != cell >> _CELL_BITS:
            continue
        place = other & (_CELLS - 1)
        if atlas.cells[place, 0] < 0:
            continue
        near = integer(indices[atlas.cells[place, 0]])
        total = integer(0)
        for axis in range(3):
            difference = integer(positions[near, axis]) - integer(positions[point, axis])
            total += difference * difference
        if total <= radius2:
            return True
    return False


def boxes(positions: Positions) -> Boxes:
    sizes = [-(-len(positions) >> _FAN_LOG2)]
    while sizes[-1] > 1:
        sizes.append(-(-sizes[-1] >> _FAN_LOG2))
    starts = np.cumsum([0, 0, *sizes])[:-1].astype(np.int64)
    result = Boxes(positions, np.empty((sum(sizes), 6), dtype=np.int32), starts)
    _fill_boxes(result, np.array(sizes, dtype=np.int64))
    return result


@entry
def _fill_boxes(result: Boxes, sizes: Ints) -> None:
    for axis in range(3):
        for k in range(sizes[0]):
            low = result.positions[k << _FAN_LOG2, axis]
            high = low
            for i in range((k << _FAN_LOG2) + 1, min((k + 1) << _FAN_LOG2, len(result.positions))):
                low = min(low, result.positions[i, axis])
                high = max(high, result.positions[i, axis])
            result.boxes[k, axis], result.boxes[k, 3 + axis] = low, high
    for level in range(1, len(sizes)):
        below, start = result.starts[level], result.starts[level + 1]
        for k in range(sizes[level]):
            first = below + (k << _FAN_LOG2)
            last = below + min((k + 1) << _FAN_LOG2, sizes[level - 1])
            for axis in range(3):
                low, high = result.boxes[first, axis], result.boxes[first, 3 + axis]
                for i in range(first + 1, last):
                    low = min(low, result.boxes[i, axis])
                    high = max(high, result.boxes[i, 3 + axis])
                result.boxes[start + k, axis], result.boxes[start + k, 3 + axis] = low, high


@inlined
def _box_distance(around: Positions, k: int, x: int, y: int, z: int) -> int:
    return (
        max(integer(around[k, 0]) - x, 0, x - integer(around[k, 3]))
        + max(integer(around[k, 1]) - y, 0, y - integer(around[k, 4]))
        + max(integer(around[k, 2]) - z, 0, z - integer(around[k, 5]))
    )


@inlined
def _with(best: Best, positions: Positions, k: int, offset: int, x: int, y: int, z: int) -> Best:
    """Insert a candidate into the three nearest, after equally near ones."""
    a, b, c, i, j, m = best
    distance = (
        abs(integer(positions[k, 0]) - x)
        + abs(integer(positions[k, 1]) - y)
        + abs(integer(positions[k, 2]) - z)
    )
    if distance >= c:
        return best
    k += offset
    if k == i or k == j or k == m:  # noqa: PLR1714, SIM109
        return best
    if distance < a:
        return distance, a, b, k, i, j
    if distance < b:
        return a, distance, b, i, k, j
    return a, b, distance, i, j, k


@inlined
def _search_forward(
    best: Best, among: Boxes, first: int, last: int, offset: int, x: int, y: int, z: int
) -> tuple[Best, int]:
    """Search positions from `first` to `last`; return the nearest and the number of operations."""
    work, level, k = 0, 1, first
    top = len(among.starts) - 1
    while k <= last and k & _FAN_MASK:
        best = _with(best, among.positions, k, offset, x, y, z)
        k += 1
    while level < top and (k >> _FAN_LOG2 * level) & _FAN_MASK == 0:
        level += 1
    while k <= last:
        work += 1
        box = among.starts[level] + (k >> _FAN_LOG2 * level)
        if _box_distance(among.boxes, box, x, y, z) < best[2]:
            if level > 1:
                level -= 1
                continue
            work += 4
            for i in range(k, min(last, k | _FAN_MASK) + 1):
                best = _with(best, among.positions, i, offset, x, y, z)
        k += 1 << _FAN_LOG2 * level
        while level < top and (k >> _FAN_LOG2 * level) & _FAN_MASK == 0:
            level += 1
    return best, work


@inlined
def _search_backward(
    best: Best, among: Boxes, first: int, last: int, x: int, y: int, z: int
) -> tuple[Best, int]:
    work, level, end = 0, 1, last + 1
    top = len(among.starts) - 1
    while end > first and end & _FAN_MASK:
        end -= 1
        best = _with(best, among.positions, end, 0, x, y, z)
    while level < top and (end >> _FAN_LOG2 * level) & _FAN_MASK == 0:
        level += 1
    while end > first:
        work += 1
        box = among.starts[level] + (end - 1 >> _FAN_LOG2 * level)
        if _box_distance(among.boxes, box, x, y, z) < best[2]:
            if level > 1:
                level -= 1
                continue
            work += 4
            for i in range(end - 1, max(first, end - 1 - _FAN_MASK) - 1, -1):
                best = _with(best, among.positions, i, 0, x, y, z)
        end -= 1 << _FAN_LOG2 * level
        while level < top and (end >> _FAN_LOG2 * level) & _FAN_MASK == 0:
            level += 1
    return best, work


class Level(NamedTuple):
    """Points of a level: codes, and those of the points of coarser levels, both sorted."""

    codes: Ints
    coarser_codes: Ints
    own: Boxes
    coarser: Boxes


@entry
def find_nearest(
    level: Level,
    options: SearchOptions,
    atlas: Atlas,
    ranges: Indices,
    nearest: Indices,
    work: int,
) -> int:
    """Write the three nearest candidates of each point, or -1, to `nearest` (n, 3).

    Indices from the number of coarser points on stand for points of the same level. `ranges`
    (27, 2) is working memory.

    Returns the rest of `work`, an upper limit of operations; it is negative if they exceed it.
    """
    codes, coarser_codes = level.codes, level.coarser_codes
    count, coarser_count = len(codes), len(coarser_codes)
    shift = min(63, 3 * options.cell_bits)
    block_shift = min(63, shift + _CELL_BITS)
    clear(atlas)
    block, cell = integer(-1), integer(-1)
    following, filled, cells = integer(0), integer(0), integer(0)
    for i in range(count):
        x, y, z = (
            integer(level.own.positions[i, 0]),
            integer(level.own.positions[i, 1]),
            integer(level.own.positions[i, 2]),
        )
        best = (_FAR, _FAR, _FAR, integer(-1), integer(-1), integer(-1))
        if coarser_count:
            code = codes[i]
            while following < coarser_count - 1 and code >= coarser_codes[following]:
                following += 1
            if code >> block_shift != block:
                clear(atlas)
                block = code >> block_shift
                while filled < coarser_count and coarser_codes[filled] >> block_shift == block:
                    set_cell(atlas, coarser_codes[filled] >> shift, filled)
                    filled += 1
            if code >> shift != cell:
                cell = code >> shift
                cells = 0
                for offset in ALL_NEIGHBOURS:
                    other = neighbour_code(cell, offset)
                    if other >> _CELL_BITS != block:
                        continue
                    place = other & (_CELLS - 1)
                    if atlas.cells[place, 0] >= 0:
                        ranges[cells, 0] = atlas.cells[place, 0]
                        ranges[cells, 1] = atlas.cells[place, 1]
                        cells += 1
            for r in range(cells):
                work -= ranges[r, 1] - ranges[r, 0]
                for k in range(ranges[r, 0], ranges[r, 1]):
                    best = _with(best, level.coarser.positions, k, 0, x, y, z)
            if best[5] < 0:
                centre = following if best[3] < 0 else best[3]
                low = max(0, centre - options.inter_range)
                high = min(coarser_count - 1, centre + options.inter_range)
                best = _with(best, level.coarser.positions, centre, 0, x, y, z)
                for n in range(1, _NEAR_RANGE + 1):
                    if centre + n <= high:
                        best = _with(best, level.coarser.positions, centre + n, 0, x, y, z)
                    if centre - n >= low:
                        best = _with(best, level.coarser.positions, centre - n, 0, x, y, z)
                after = min(coarser_count - 1, centre + _NEAR_RANGE + 1)
                before = max(0, centre - _NEAR_RANGE - 1)
                best, spent = _search_forward(best, level.coarser, after, high, 0, x, y, z)
                work -= spent
                best, spent = _search_backward(best, level.coarser, low, before, x, y, z)
                work -= spent
        if options.intra:
            near_end = min(count - 1, i + 1 + _NEAR_RANGE)
            for k in range(i + 1, near_end + 1):
                best = _with(best, level.own.positions, k, coarser_count, x, y, z)
            high = min(count - 1, i + 1 + options.intra_range)
            best, spent = _search_forward(
                best, level.own, near_end + 1, high, coarser_count, x, y, z
            )
            work -= spent
        nearest[i, 0], nearest[i, 1], nearest[i, 2] = best[3], best[4], best[5]
        if work < 0:
            break
    return work


class Predictors(NamedTuple):
    """Up to three points that predict each point (n,), in coding order.

    counts: number of neighbours.
    neighbours: (n, 3) their places in coding order, which precede the point's.
    weights: (n, 3) squared distances, or weights whose sum is 2^FRACTION_BITS.
    """

    counts: NDArray[np.uint8]
    neighbours: Indices
    weights: Ints


def nearest_neighbours(
    points: SortedPoints,
    options: SearchOptions,
    bias: Ints,
    order: Indices,
    part: slice,
    retained: Indices,
    predictors: Predictors,
    atlas: Atlas,
    work: int,
) -> int:
    """Find the predictors of the points that `order` has in `part`, a level of detail.

    retained: points of coarser levels.
    bias: factors (3,) of distances.
    work: see `find_nearest`, whose result is returned. In `predictors`, neighbours are points.
    """
    own = order[part]
    scale = bias.astype(np.int32)
    placed = [points.positions[rows] for rows in (own, retained)]
    if options.mask_bits:
        placed = [rows >> options.mask_bits << options.mask_bits for rows in placed]
    own_boxes, coarser_boxes = (boxes(rows * scale) for rows in placed)
    level = Level(points.codes[own], points.codes[retained], own_boxes, coarser_boxes)
    nearest = np.empty((len(own), 3), dtype=np.int32)
    work = find_nearest(level, options, atlas, np.empty((27, 2), np.int32), nearest, work)
    if work >= 0:
        _write_predictors(
            options, points.positions, bias, order, part.start, retained, nearest, predictors
        )
    return work


@entry
def _write_predictors(
    options: SearchOptions,
    positions: Positions,
    bias: Ints,
    order: Indices,
    start: int,
    retained: Indices,
    nearest: Indices,
    predictors: Predictors,
) -> None:
    counts, neighbours, weights = predictors
    for i in range(len(nearest)):
        place = len(order) - 1 - start - i
        point = integer(order[start + i])
        count = integer(0)
        while count < options.most and nearest[i, count] >= 0:
            index = integer(nearest[i, count])
            if index < len(retained):
                neighbour = integer(retained[index])
            else:
                neighbour = integer(order[start + index - len(retained)])
            plain, biased = integer(0), integer(0)
            for axis in range(3):
                difference = (integer(positions[point, axis]) >> options.mask_bits) - (
                    integer(positions[neighbour, axis]) >> options.mask_bits
                )
                difference <<= options.mask_bits
                plain += difference * difference
                biased += (difference * bias[axis]) * (difference * bias[axis])
            if count and options.most_distance >= 0 and plain > options.most_distance:
                break
            neighbours[place, count] = neighbour
            weights[place, count] = biased
            count += 1
        counts[place] = count
        if count > 1:
            _sort_pair(neighbours, weights, place, 0)
        if count == 3 and weights[place, 1] > weights[place, 2]:
            _sort_pair(neighbours, weights, place, 1)
            _sort_pair(neighbours, weights, place, 0)


@inlined
def _sort_pair(neighbours: Indices, weights: Ints, place: int, first: int) -> None:
    second = first + 1
    if weights[place, first] > weights[place, second]:
        weight, neighbour = weights[place, first], neighbours[place, first]
        weights[place, first] = weights[place, second]
        neighbours[place, first] = neighbours[place, second]
        weights[place, second], neighbours[place, second] = weight, neighbour

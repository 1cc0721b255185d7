"""Search of the three nearest neighbours of points in a level of detail.

Candidates are points of coarser levels, first in the same and adjacent cells, and preceding points
of the same level. In TMC13: `computeNearestNeighbors`, `BoxHierarchy`, `MortonIndexMap3d`.
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
_LARGEST_CELL_BITS = 20
_MOST_IN_CELLS = 256
_DENSITY = 4
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
    """Grid of 128^3 cells: first and last + 1 of each one's points; `filled` cells in `used`."""

    cells: Indices
    used: Indices
    filled: Ints


class SortedPoints(NamedTuple):
    """Points in Morton order: codes (n,), positions (n, 3), and indices (n,)."""

    codes: Ints
    positions: Positions
    indices: Indices


class SearchOptions(NamedTuple):
    """Options of a level.

    cell_bits: log2 of the cells' side.
    inter_range, intra_range: number of candidates before and after the point, in coarser levels
        and in the same level.
    most: number of neighbours.
    mask_bits: ignored low bits of coordinates.
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


Atlases = tuple[Atlas, Atlas, Atlas]


def empty_atlases() -> Atlases:
    return _empty_atlas(), _empty_atlas(), _empty_atlas()


def _empty_atlas() -> Atlas:
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
    """Return whether preceding cells hold a point within a radius (squared: radius2) of `point`."""
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
def _distance(positions: Positions, k: int, x: int, y: int, z: int) -> int:
    return (
        abs(integer(positions[k, 0]) - x)
        + abs(integer(positions[k, 1]) - y)
        + abs(integer(positions[k, 2]) - z)
    )


@inlined
def _with(best: Best, positions: Positions, k: int, offset: int, x: int, y: int, z: int) -> Best:
    """Insert a candidate into the three nearest points, after equidistant ones."""
    a, b, c, i, j, m = best
    distance = _distance(positions, k, x, y, z)
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
    best: Best,
    among: Boxes,
    first: int,
    last: int,
    offset: int,
    limit: int,
    x: int,
    y: int,
    z: int,
) -> tuple[Best, int]:
    """Search positions `first` to `last` within `limit`; return the nearest and the operations."""
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
        if _box_distance(among.boxes, box, x, y, z) < min(best[2], limit + 1):
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
    best: Best, among: Boxes, first: int, last: int, limit: int, x: int, y: int, z: int
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
        if _box_distance(among.boxes, box, x, y, z) < min(best[2], limit + 1):
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


class Grid(NamedTuple):
    """Cells with a side of 2^(shift / 3) that hold points sorted by `codes`.

    ranges: (27, 2) first and last + 1 of the points in the cells around the current one.
    state: (5,) block and code of the current cell; points that are in the atlas; number of ranges;
        number of their points, or -1 if some cells are in other blocks.
    complete: whether to skip empty blocks. In TMC13, the first one ends the filling of the atlas.
    """

    codes: Ints
    atlas: Atlas
    shift: int
    ranges: Indices
    state: Ints
    complete: bool


def grid(codes: Ints, atlas: Atlas, cell_bits: int, complete: bool) -> Grid:
    state = np.array([-1, -1, 0, 0, 0], dtype=np.int64)
    return Grid(codes, atlas, min(63, 3 * cell_bits), np.empty((27, 2), np.int32), state, complete)


def _dense_cell_bits(codes: Ints) -> int:
    """Return log2 of the side of cells with two points on average."""
    steps = codes[1:] ^ codes[:-1]
    for bits in range(1, _LARGEST_CELL_BITS):
        if np.count_nonzero(steps >> 3 * bits) * _DENSITY <= len(codes):
            return bits
    return _LARGEST_CELL_BITS


@inlined
def _enter_cell(of: Grid, code: int) -> None:
    """Find the points in the cells around a code; codes must ascend."""
    state, shift = of.state, of.shift
    if code >> shift == state[1]:
        return
    block_shift = min(63, shift + _CELL_BITS)
    block, cell = code >> block_shift, code >> shift
    if block != state[0]:
        clear(of.atlas)
        state[0] = block
        while (
            of.complete and state[2] < len(of.codes) and of.codes[state[2]] >> block_shift < block
        ):
            state[2] += 1
        while state[2] < len(of.codes) and of.codes[state[2]] >> block_shift == block:
            set_cell(of.atlas, of.codes[state[2]] >> shift, state[2])
            state[2] += 1
    state[1] = cell
    ranges, total, whole = integer(0), integer(0), True
    for offset in ALL_NEIGHBOURS:
        other = neighbour_code(cell, offset)
        if other >> _CELL_BITS != block:
            whole = False
            continue
        place = other & (_CELLS - 1)
        if of.atlas.cells[place, 0] >= 0:
            of.ranges[ranges, 0] = of.atlas.cells[place, 0]
            of.ranges[ranges, 1] = of.atlas.cells[place, 1]
            total += of.atlas.cells[place, 1] - of.atlas.cells[place, 0]
            ranges += 1
    state[3] = ranges
    state[4] = total if whole else -1


class Level(NamedTuple):
    """Points of a level, and those of coarser levels, both sorted by their codes.

    near: cells of the coarser points in which neighbours are searched first.
    coarser_grid, same_level_grid: smaller or larger cells that hold a few points each.
    least_bias: smallest factor of distances.
    """

    codes: Ints
    same_level: Boxes
    coarser: Boxes
    near: Grid
    coarser_grid: Grid
    same_level_grid: Grid
    least_bias: int


@entry
def find_nearest(level: Level, options: SearchOptions, nearest: Indices, work: int) -> int:
    """Write the three nearest candidates of each point, or -1, to `nearest` (n, 3).

    Indices from the number of coarser points on are those of the same level. Returns what is left
    of `work`, the limit of operations; negative if exceeded.
    """
    coarser_codes = level.near.codes
    coarser_count, following = len(coarser_codes), integer(0)
    clear(level.near.atlas)
    clear(level.coarser_grid.atlas)
    clear(level.same_level_grid.atlas)
    for i in range(len(level.codes)):
        best = (_FAR, _FAR, _FAR, integer(-1), integer(-1), integer(-1))
        if coarser_count:
            code = level.codes[i]
            while following < coarser_count - 1 and code >= coarser_codes[following]:
                following += 1
            best, spent = _search_near(best, level, i)
            work -= spent
            if best[5] < 0:
                best, spent = _search_coarser(best, level, options, i, following)
                work -= spent
        if options.intra:
            best, spent = _search_same_level(best, level, options, i, coarser_count)
            work -= spent
        nearest[i, 0], nearest[i, 1], nearest[i, 2] = best[3], best[4], best[5]
        if work < 0:
            break
    return work


@inlined
def _place(level: Level, i: int) -> tuple[int, int, int]:
    positions = level.same_level.positions
    return integer(positions[i, 0]), integer(positions[i, 1]), integer(positions[i, 2])


@inlined
def _search_near(best: Best, level: Level, i: int) -> tuple[Best, int]:
    x, y, z = _place(level, i)
    _enter_cell(level.near, level.codes[i])
    work = integer(0)
    for r in range(level.near.state[3]):
        first, end = integer(level.near.ranges[r, 0]), integer(level.near.ranges[r, 1])
        work += end - first
        for k in range(first, end):
            best = _with(best, level.coarser.positions, k, 0, x, y, z)
    return best, work


@inlined
def _search_coarser(
    best: Best, level: Level, options: SearchOptions, i: int, following: int
) -> tuple[Best, int]:
    """Search coarser points by their distance from a centre in Morton order."""
    x, y, z = _place(level, i)
    positions = level.coarser.positions
    last = len(positions) - 1
    centre = following if best[3] < 0 else best[3]
    low, high = max(0, centre - options.inter_range), min(last, centre + options.inter_range)
    limit = _FAR
    _enter_cell(level.coarser_grid, level.codes[i])
    in_cells = level.coarser_grid.state[4]
    if level.coarser_grid.complete and 0 <= in_cells <= _MOST_IN_CELLS:
        in_cells_best = _search_cells(best, level, (centre, low, high), x, y, z)
        if in_cells_best[2] <= level.least_bias << level.coarser_grid.shift // 3:
            return in_cells_best, in_cells
        limit = in_cells_best[2]
    best = _with(best, positions, centre, 0, x, y, z)
    for n in range(1, _NEAR_RANGE + 1):
        if centre + n <= high:
            best = _with(best, positions, centre + n, 0, x, y, z)
        if centre - n >= low:
            best = _with(best, positions, centre - n, 0, x, y, z)
    after, before = min(last, centre + _NEAR_RANGE + 1), max(0, centre - _NEAR_RANGE - 1)
    best, work = _search_forward(best, level.coarser, after, high, 0, limit, x, y, z)
    best, more = _search_backward(best, level.coarser, low, before, limit, x, y, z)
    return best, work + more


@inlined
def _search_cells(
    best: Best, level: Level, span: tuple[int, int, int], x: int, y: int, z: int
) -> Best:
    """Search cells of coarser points; equidistant ones in the order of `_search_coarser`.

    span: centre, lowest and highest index.
    """
    centre, low, high = span
    of, positions = level.coarser_grid, level.coarser.positions
    count, nearest, second = len(positions), best[3], best[4]
    ranked = (
        best[0],
        best[1],
        best[2],
        integer(-2 if nearest >= 0 else _FAR),
        integer(-1 if second >= 0 else _FAR),
        integer(_FAR),
    )
    for r in range(of.state[3]):
        first, end = integer(of.ranges[r, 0]), integer(of.ranges[r, 1])
        for k in range(max(first, low), min(end, high + 1)):
            if k not in (nearest, second):
                ranked = _with_tied(ranked, positions, k, _rank(k, centre, count) - k, x, y, z)
    return (
        ranked[0],
        ranked[1],
        ranked[2],
        _index(ranked[3], centre, count, nearest, second),
        _index(ranked[4], centre, count, nearest, second),
        _index(ranked[5], centre, count, nearest, second),
    )


@inlined
def _rank(k: int, centre: int, count: int) -> int:
    """Return an index's place in the search.

    The order is, from the centre, 0, 1, -1, 2, -2, then all above, then all below.
    """
    away = k - centre
    if abs(away) <= _NEAR_RANGE:
        return 2 * away - 1 if away > 0 else -2 * away
    return away + _NEAR_RANGE if away > 0 else count + _NEAR_RANGE - away


@inlined
def _index(rank: int, centre: int, count: int, nearest: int, second: int) -> int:
    if rank < 0:
        return nearest if rank == -2 else second
    if rank == _FAR:
        return integer(-1)
    if rank <= 2 * _NEAR_RANGE:
        return centre + (rank + 1 >> 1 if rank & 1 else -(rank >> 1))
    if rank <= count + _NEAR_RANGE:
        return centre + rank - _NEAR_RANGE
    return centre + count + _NEAR_RANGE - rank


@inlined
def _search_same_level(
    best: Best, level: Level, options: SearchOptions, i: int, offset: int
) -> tuple[Best, int]:
    """Search points of the same level, with ascending indices above `i`."""
    x, y, z = _place(level, i)
    positions = level.same_level.positions
    last = len(positions) - 1
    near_end, high = min(last, i + 1 + _NEAR_RANGE), min(last, i + 1 + options.intra_range)
    limit = _FAR
    if level.same_level_grid.shift:
        _enter_cell(level.same_level_grid, level.codes[i])
        in_cells = level.same_level_grid.state[4]
        if 0 <= in_cells <= _MOST_IN_CELLS:
            in_cells_best = best
            for r in range(level.same_level_grid.state[3]):
                first = integer(level.same_level_grid.ranges[r, 0])
                end = integer(level.same_level_grid.ranges[r, 1])
                for k in range(max(first, i + 1), min(end, max(near_end, high) + 1)):
                    in_cells_best = _with_tied(in_cells_best, positions, k, offset, x, y, z)
            if in_cells_best[2] <= level.least_bias << level.same_level_grid.shift // 3:
                return in_cells_best, in_cells
            limit = in_cells_best[2]
    for k in range(i + 1, near_end + 1):
        best = _with(best, positions, k, offset, x, y, z)
    return _search_forward(best, level.same_level, near_end + 1, high, offset, limit, x, y, z)


@inlined
def _with_tied(
    best: Best, positions: Positions, k: int, offset: int, x: int, y: int, z: int
) -> Best:
    """Insert a candidate into the three nearest points; equidistant ones by index."""
    a, b, c, i, j, m = best
    distance = _distance(positions, k, x, y, z)
    k += offset
    if distance > c or (distance == c and k > m):
        return best
    if distance < a or (distance == a and k < i):
        return distance, a, b, k, i, j
    if distance < b or (distance == b and k < j):
        return a, distance, b, i, k, j
    return a, b, distance, i, j, k


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
    atlases: Atlases,
    work: int,
) -> int:
    """Find the predictors of the points `order[part]`, a level of detail.

    retained: points of coarser levels.
    bias: factors (3,) of distances.
    work: as for `find_nearest`. In `predictors`, neighbours are points.
    """
    same_level = order[part]
    scale = bias.astype(np.int32)
    placed = [points.positions[rows] for rows in (same_level, retained)]
    if options.mask_bits:
        placed = [rows >> options.mask_bits << options.mask_bits for rows in placed]
    same_level_boxes, coarser_boxes = (boxes(rows * scale) for rows in placed)
    codes, coarser_codes = points.codes[same_level], points.codes[retained]
    near, coarser_grid, same_level_grid = atlases
    is_sorted = len(codes) > 1 and codes[0] != codes[-1]
    level = Level(
        codes,
        same_level_boxes,
        coarser_boxes,
        grid(coarser_codes, near, options.cell_bits, False),
        grid(coarser_codes, coarser_grid, _dense_cell_bits(coarser_codes), not options.mask_bits),
        grid(
            codes,
            same_level_grid,
            _dense_cell_bits(codes) if is_sorted and not options.mask_bits else 0,
            True,
        ),
        int(bias.min()),
    )
    nearest = np.empty((len(same_level), 3), dtype=np.int32)
    work = find_nearest(level, options, nearest, work)
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

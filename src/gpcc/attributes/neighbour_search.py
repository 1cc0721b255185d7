"""Search for the three nearest neighbours of each point in a level of detail.

Candidates are points of coarser levels, first in the same and adjacent cells, and points of the
same level that are coded earlier. In TMC13: `computeNearestNeighbors`, `BoxHierarchy`,
`MortonIndexMap3d`.
"""

from __future__ import annotations

import threading
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.compiled import entry, integer, row
from gpcc.kd_tree import Int32s
from pointkit.compiling import inlined
from pointkit.geometry.morton import X_BITS, Y_BITS, Z_BITS, Ints
from pointkit.threads import allowed_threads, in_threads

Best = tuple[int, int, int]

_CELL_BITS = 21
_CELLS = 1 << _CELL_BITS
_FAR = 1 << 62
_RANK_BITS = 32
_RANKS = (1 << _RANK_BITS) - 1
_NEAR_RANGE = 2
_LARGEST_CELL_BITS = 20
_MOST_IN_CELLS = 256
_FAN_LOG2 = 3
_FAN_MASK = 7
_LEAST_PART = 1 << 14
"""Minimum number of points for which a thread searches."""

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
    """Grid of 128^3 cells that hold points; cells are emptied one by one."""

    # (128^3, 2) first index of a cell's points, and last index + 1 (0 if empty).
    cells: Int32s
    # used, filled: codes of the occupied cells, and (1,) their number.
    used: Int32s
    filled: Ints


class SortedPoints(NamedTuple):
    """Points in Morton order, as codes (n,), positions (n, 3) and indices (n,)."""

    codes: Ints
    positions: Int32s
    indices: Int32s


class SearchOptions(NamedTuple):
    """Options of the search for the neighbours of points of one level of detail."""

    # Log2 of the cells' side.
    cell_bits: int
    # Number of candidates before and after the centre in coarser levels.
    inter_range: int
    # intra, intra_range: whether points of the same level are candidates, and how many.
    intra: bool
    intra_range: int
    # Maximum number of neighbours.
    most: int
    # Ignored low bits of coordinates.
    mask_bits: int
    # Squared distance beyond which only the nearest neighbour is used, or -1.
    most_distance: int


class Boxes(NamedTuple):
    """Positions (n, 3), and the bounding boxes of 8, 64, 512, ... successive positions."""

    positions: Int32s
    # (m, 6), first the boxes of 8 positions.
    boxes: Int32s
    # First box of each size; index 0 is not used.
    starts: Ints


Atlases = tuple[Atlas, Atlas, Atlas]


def empty_atlas() -> Atlas:
    return Atlas(
        np.zeros((_CELLS, 2), dtype=np.int32),
        np.empty(_CELLS, dtype=np.int32),
        np.zeros(1, dtype=np.int64),
    )


class _WorkingMemory(threading.local):
    """Atlases of each thread; clearing their used cells is faster than allocating new ones."""

    @cached_property
    def atlases(self) -> Atlases:
        return empty_atlas(), empty_atlas(), empty_atlas()


MEMORY = _WorkingMemory()


@inlined
def neighbour_code(code: int, offset: int) -> int:
    """Return the Morton code of a cell at an offset of -1 to 1 along each axis, with wraparound."""
    along_x, along_y = _moved(code, offset, X_BITS, 4), _moved(code, offset, Y_BITS, 2)
    return along_x | along_y | _moved(code, offset, Z_BITS, 1)


@inlined
def _moved(code: int, offset: int, axis_bits: int, lowest: int) -> int:
    lower = (code & axis_bits) - lowest
    return ((lower & axis_bits | ~axis_bits) + (offset & axis_bits)) & axis_bits


@inlined
def set_cell(atlas: Atlas, code: int, index: int) -> None:
    cell = code & (_CELLS - 1)
    if not atlas.cells[cell, 1]:
        atlas.cells[cell, 0] = index
        atlas.used[atlas.filled[0]] = cell
        atlas.filled[0] += 1
    atlas.cells[cell, 1] = index + 1


@inlined
def clear(atlas: Atlas) -> None:
    for k in range(atlas.filled[0]):
        atlas.cells[atlas.used[k], 1] = 0
    atlas.filled[0] = 0


@inlined
def holds_near_point(
    positions: Int32s, indices: Int32s, atlas: Atlas, point: int, cell: int, radius2: int
) -> bool:
    """Return whether the first point of a preceding adjacent cell is near a point.

    Near means that the squared distance is at most `radius2`.
    """
    for offset in PRECEDING_NEIGHBOURS:
        other = neighbour_code(cell, offset)
        if other >> _CELL_BITS != cell >> _CELL_BITS:
            continue
        place = other & (_CELLS - 1)
        if not atlas.cells[place, 1]:
            continue
        near = integer(indices[atlas.cells[place, 0]])
        if squared_distance(positions, near, point) <= radius2:
            return True
    return False


@inlined
def squared_distance(positions: Int32s, i: int, k: int) -> int:
    (a, b, c), (x, y, z) = row(positions, i), row(positions, k)
    return (a - x) * (a - x) + (b - y) * (b - y) + (c - z) * (c - z)


def boxes(positions: Int32s) -> Boxes:
    low = high = positions
    whole, starts = np.empty((0, 6), dtype=np.int32), [0]
    while len(low) > 1 or len(low) > len(whole):
        starts.append(len(whole))
        firsts = np.arange(0, len(low), 1 << _FAN_LOG2)
        low, high = np.minimum.reduceat(low, firsts), np.maximum.reduceat(high, firsts)
        whole = np.concatenate([whole, np.hstack([low, high])])
    return Boxes(positions, whole, np.array(starts, dtype=np.int64))


@inlined
def _box_distance(around: Int32s, k: int, x: int, y: int, z: int) -> int:
    return (
        max(integer(around[k, 0]) - x, 0, x - integer(around[k, 3]))
        + max(integer(around[k, 1]) - y, 0, y - integer(around[k, 4]))
        + max(integer(around[k, 2]) - z, 0, z - integer(around[k, 5]))
    )


@inlined
def _distance(positions: Int32s, k: int, x: int, y: int, z: int) -> int:
    a, b, c = row(positions, k)
    return abs(a - x) + abs(b - y) + abs(c - z)


class Query(NamedTuple):
    """A point, and the candidates for its neighbours."""

    x: int
    y: int
    z: int
    # low, high: indices of the first and the last candidate.
    low: int
    high: int
    # Index where the search starts, or -1 for a search in ascending order.
    centre: int
    # Number of points in coarser levels.
    coarser: int
    # nearest, second: the two nearest points so far, or -1; they rank before all candidates.
    nearest: int
    second: int


@inlined
def _rank(query: Query, k: int) -> int:
    """Return the rank of a candidate, which decides between equidistant candidates."""
    # Near candidates rank first, by offset from the centre: 0, 1, -1, 2, -2, ...; those after the
    # centre follow; those before the centre are last.
    if query.centre < 0:
        return query.coarser + k
    away = k - query.centre
    if abs(away) <= _NEAR_RANGE:
        return 2 + (2 * away - 1 if away > 0 else -2 * away)
    return 2 + _NEAR_RANGE + (away if away > 0 else query.coarser - away)


@inlined
def _with_index(query: Query, key: int) -> int:
    """Replace the rank of a coarser candidate in the key (see `_with`) by the candidate's index."""
    rank = (key & _RANKS) - 2
    if key == _FAR:
        return key
    if rank < 0:
        index = query.nearest if rank == -2 else query.second
    elif rank <= 2 * _NEAR_RANGE:
        index = query.centre + (rank + 1 >> 1 if rank & 1 else -(rank >> 1))
    elif rank <= query.coarser + _NEAR_RANGE:
        index = query.centre + rank - _NEAR_RANGE
    else:
        index = query.centre + query.coarser + _NEAR_RANGE - rank
    return key & ~_RANKS | index


@inlined
def _with(best: Best, query: Query, distance: int, k: int) -> Best:
    """Insert a candidate's key (distance * 2^32 + rank) into the three smallest keys."""
    a, b, c = best
    if k < query.low or k > query.high or k == query.nearest or k == query.second:  # noqa: PLR1714
        return best
    key = integer(distance) << _RANK_BITS | _rank(query, k)
    if key >= c or key == a or key == b:  # noqa: PLR1714, SIM109
        return best
    if key < a:
        return key, a, b
    return (a, key, b) if key < b else (a, b, key)


@inlined
def _search_span(best: Best, query: Query, positions: Int32s, first: int, last: int) -> Best:
    for k in range(max(first, query.low), min(last, query.high) + 1):
        distance = _distance(positions, k, query.x, query.y, query.z)
        if distance <= best[2] >> _RANK_BITS:
            best = _with(best, query, distance, k)
    return best


@inlined
def _search_boxes(best: Best, query: Query, candidates: Boxes) -> tuple[Best, int]:
    """Search all candidates, and return the nearest and the number of operations."""
    top = len(candidates.starts) - 1
    work, level, k = 0, top, query.low >> _FAN_LOG2 * top << _FAN_LOG2 * top
    while k <= query.high:
        size = 1 << _FAN_LOG2 * level
        first, last = max(k, query.low), min(k + size - 1, query.high)
        if first <= last:
            work += 1
            box = candidates.starts[level] + (k >> _FAN_LOG2 * level)
            least = _box_distance(candidates.boxes, box, query.x, query.y, query.z) << _RANK_BITS
            if least | _rank(query, min(max(first, query.centre), last)) < best[2]:
                if level > 1:
                    level -= 1
                    continue
                work += 4
                best = _search_span(best, query, candidates.positions, first, last)
        k += size
        while level < top and (k >> _FAN_LOG2 * level) & _FAN_MASK == 0:
            level += 1
    return best, work


class Grid(NamedTuple):
    """Cells with a side of 2^(shift / 3), which hold points sorted by `codes`."""

    codes: Ints
    positions: Int32s
    atlas: Atlas
    shift: int
    # Factors (3,) of distances.
    bias: Ints
    # (27, 2) first index and last index + 1 of the points in the current cell, then in each
    # adjacent cell.
    ranges: Int32s
    # (6,) block (128^3 cells) and code of the current cell; index of the next point for the atlas;
    # number of ranges; number of points in them; whether all cells are in one block.
    state: Ints
    # Whether to skip blocks without a query; in TMC13, such a block ends the filling of the atlas.
    complete: bool
    # Whether to leave out cells that precede the current one.
    following: bool


def grid(
    codes: Ints,
    positions: Int32s,
    bias: Ints,
    atlas: Atlas,
    cell_bits: int,
    complete: bool,
    following: bool = False,
) -> Grid:
    return Grid(
        codes,
        positions,
        atlas,
        min(63, 3 * cell_bits),
        bias,
        np.zeros((27, 2), dtype=np.int32),
        np.array([-1, -1, 0, 0, 0, 0], dtype=np.int64),
        complete,
        following,
    )


def _dense_cell_bits(codes: Ints, density: int) -> int:
    """Return log2 of the side of the smallest cells with `density` points on average."""
    steps = codes[1:] ^ codes[:-1]
    for bits in range(1, _LARGEST_CELL_BITS):
        if np.count_nonzero(steps >> 3 * bits) * density <= len(codes):
            return bits
    return _LARGEST_CELL_BITS


@inlined
def _enter_cell(grid: Grid, code: int) -> None:
    """Find the points in a code's cell and its neighbours; codes must ascend from call to call."""
    state, shift = grid.state, grid.shift
    if code >> shift == state[1]:
        return
    block_shift = min(63, shift + _CELL_BITS)
    block, cell = code >> block_shift, code >> shift
    if block != state[0]:
        _fill_atlas(grid, block, block_shift)
    state[1], state[3], state[4], state[5] = cell, 0, 0, 1
    if not grid.atlas.filled[0]:
        state[5] = 0
        return
    low, high = neighbour_code(cell, 0), neighbour_code(cell, 56)
    for offset in ALL_NEIGHBOURS:
        other = (
            _chosen(low, cell, high, offset, X_BITS, 2)
            | _chosen(low, cell, high, offset, Y_BITS, 1)
            | _chosen(low, cell, high, offset, Z_BITS, 0)
        )
        if grid.following and other < cell:
            continue
        if other >> _CELL_BITS != block:
            state[5] = 0
            continue
        place = other & (_CELLS - 1)
        if grid.atlas.cells[place, 1]:
            grid.ranges[state[3], 0] = grid.atlas.cells[place, 0]
            grid.ranges[state[3], 1] = grid.atlas.cells[place, 1]
            state[3] += 1
            state[4] += grid.atlas.cells[place, 1] - grid.atlas.cells[place, 0]


@inlined
def _fill_atlas(grid: Grid, block: int, block_shift: int) -> None:
    state, codes = grid.state, grid.codes
    clear(grid.atlas)
    state[0] = block
    while grid.complete and state[2] < len(codes) and codes[state[2]] >> block_shift < block:
        state[2] += 1
    while state[2] < len(codes) and codes[state[2]] >> block_shift == block:
        set_cell(grid.atlas, codes[state[2]] >> grid.shift, state[2])
        state[2] += 1


@inlined
def _chosen(low: int, same: int, high: int, offset: int, axis_bits: int, place: int) -> int:
    step = offset >> place & 9
    return (low if step == 0 else same if step == 1 else high) & axis_bits


@inlined
def _search_cells(best: Best, query: Query, grid: Grid, code: int) -> tuple[Best, int]:
    """Search a point's cell and the adjacent cells, unless they hold too many points."""
    # All points nearer than the returned distance are found.
    _enter_cell(grid, code)
    if grid.state[4] > _MOST_IN_CELLS:
        return best, integer(0)
    for r in range(grid.state[3]):
        first = query.low if grid.following and r == 0 else integer(grid.ranges[r, 0])
        for k in range(first, grid.ranges[r, 1]):
            distance = _distance(grid.positions, k, query.x, query.y, query.z)
            if distance <= best[2] >> _RANK_BITS:
                best = _with(best, query, distance, k)
    side, reach = integer(1) << grid.shift // 3, grid.state[5] * _FAR
    for axis in range(3):
        bias = grid.bias[axis]
        place = query.x if axis == 0 else query.y if axis == 1 else query.z
        if bias > 1:
            place //= bias
        place &= side - 1
        reach = min(reach, (side + min(place + 1, side - place)) * bias)
    return best, reach


class Level(NamedTuple):
    """Points of a level of detail and points of coarser levels, both sorted by their codes."""

    codes: Ints
    same_level: Boxes
    coarser: Boxes
    # Grid of the coarser points; the search starts in a point's cell and its neighbours.
    near: Grid
    # coarser_grid, same_level_grid: grids with a few points in each cell, for a fast search.
    coarser_grid: Grid
    same_level_grid: Grid


@entry
def find_nearest(
    level: Level, options: SearchOptions, nearest: Int32s, first: int, end: int, work: int
) -> int:
    """Find the three candidates that are nearest to the points `first` to `end` - 1 of a level.

    Parameters
    ----------
    level, options
        Points and candidates, and options of the search.
    nearest
        Result (n, 3), the nearest first, -1 where there are fewer. With c coarser points, an index
        below c is that of a coarser point, and c + i is point i of the same level.
    first, end
        The points of the level.
    work
        Number of operations that the search may take.

    Returns
    -------
    int
        Number of operations left. If it is negative, the search has stopped.
    """
    coarser_codes = level.near.codes
    coarser_count, following = len(coarser_codes), integer(0)
    clear(level.near.atlas)
    clear(level.coarser_grid.atlas)
    clear(level.same_level_grid.atlas)
    _skip_points(level.near, level.codes, first)
    for i in range(first, end):
        best = (integer(_FAR), integer(_FAR), integer(_FAR))
        if coarser_count:
            code = level.codes[i]
            while following < coarser_count - 1 and code >= coarser_codes[following]:
                following += 1
            best, spent = _search_coarser(level, options, i, following)
            work -= spent
        if options.intra:
            best, spent = _search_same_level(best, level, options, i, coarser_count)
            work -= spent
        for k in range(3):
            nearest[i, k] = integer(-1) if best[k] == _FAR else best[k] & _RANKS
        if work < 0:
            break
    return work


@inlined
def _skip_points(grid: Grid, codes: Ints, first: int) -> None:
    """Set the state of a grid to what it is after the search for the points before `first`.

    So the search can begin at any point of a level.
    """
    block_shift, candidates = min(63, grid.shift + _CELL_BITS), grid.codes
    passed, following, block = integer(-1), grid.state[2], codes[first] >> block_shift
    for i in range(first):
        if codes[i] >> block_shift == block:
            break
        if codes[i] >> block_shift != passed:
            passed = codes[i] >> block_shift
            while following < len(candidates) and candidates[following] >> block_shift == passed:
                following += 1
    grid.state[2] = following


@inlined
def _search_near(level: Level, i: int) -> tuple[Best, Best, int]:
    """Return the three nearest coarser points in near cells, and the number of operations.

    The points are given as squared distances, then as indices.
    """
    x, y, z = row(level.same_level.positions, i)
    a = b = c = integer(_FAR)
    first = second = third = integer(-1)
    _enter_cell(level.near, level.codes[i])
    work = integer(0)
    for r in range(level.near.state[3]):
        start, end = integer(level.near.ranges[r, 0]), integer(level.near.ranges[r, 1])
        work += end - start
        for k in range(start, end):
            distance = _distance(level.coarser.positions, k, x, y, z)
            if distance >= c:
                continue
            if distance < a:
                a, b, c, first, second, third = distance, a, b, k, first, second
            elif distance < b:
                b, c, second, third = distance, b, k, second
            else:
                c, third = distance, k
    return (a, b, c), (first, second, third), work


@inlined
def _search_coarser(
    level: Level, options: SearchOptions, i: int, following: int
) -> tuple[Best, int]:
    """Search coarser points in near cells, then around a centre in Morton order."""
    distances, indices, work = _search_near(level, i)
    a, b, c = distances[0] << _RANK_BITS, distances[1] << _RANK_BITS, distances[2] << _RANK_BITS
    if indices[2] >= 0:
        return (a | indices[0], b | indices[1], c | indices[2]), work
    far = integer(_FAR)
    best = (a if indices[0] >= 0 else far, b | 1 if indices[1] >= 0 else far, far)
    x, y, z = row(level.same_level.positions, i)
    count = len(level.coarser.positions)
    centre = following if indices[0] < 0 else indices[0]
    low, high = max(0, centre - options.inter_range), min(count - 1, centre + options.inter_range)
    query = Query(x, y, z, low, high, centre, count, indices[0], indices[1])
    reach = integer(0)
    if level.coarser_grid.complete:
        best, reach = _search_cells(best, query, level.coarser_grid, level.codes[i])
        work += level.coarser_grid.state[4]
    if best[2] >> _RANK_BITS >= reach:
        first, end = centre - _NEAR_RANGE, centre + _NEAR_RANGE
        best = _search_span(best, query, level.coarser.positions, first, end)
        best, spent = _search_boxes(best, query, level.coarser)
        work += spent
    a, b, c = best
    return (_with_index(query, a), _with_index(query, b), _with_index(query, c)), work


@inlined
def _search_same_level(
    best: Best, level: Level, options: SearchOptions, i: int, offset: int
) -> tuple[Best, int]:
    """Search points of the same level in ascending order from the index `i` + 1."""
    x, y, z = row(level.same_level.positions, i)
    positions = level.same_level.positions
    last = len(positions) - 1
    near_end, high = min(last, i + 1 + _NEAR_RANGE), min(last, i + 1 + options.intra_range)
    none = integer(-1)
    query = Query(x, y, z, i + 1, max(near_end, high), none, offset, none, none)
    reach, work = integer(0), integer(0)
    if level.same_level_grid.shift:
        best, reach = _search_cells(best, query, level.same_level_grid, level.codes[i])
        work += level.same_level_grid.state[4]
    if best[2] >> _RANK_BITS < reach:
        return best, work
    best = _search_span(best, query, positions, i + 1, near_end)
    best, spent = _search_boxes(best, query, level.same_level)
    return best, work + spent


class Predictors(NamedTuple):
    """The points, at most three, that predict each point (n,) in coding order."""

    # Number of neighbours.
    counts: NDArray[np.uint8]
    # (n, 3) places of the neighbours in coding order, before the point.
    neighbours: Int32s
    # (n, 3) squared distances, or weights whose sum is 2^FRACTION_BITS.
    weights: Ints


def nearest_neighbours(
    points: SortedPoints,
    options: SearchOptions,
    bias: Ints,
    order: Int32s,
    part: slice,
    retained: Int32s,
    predictors: Predictors,
    work: int,
) -> int:
    """Find the points that predict the points `order[part]`, which are one level of detail.

    Parameters
    ----------
    points
        The points of the slice.
    options
        Options of the search.
    bias
        Factors (3,) of distances along the axes.
    order
        Indices of the slice's points, finest level first.
    part
        Slice of `order` with the points of this level.
    retained
        Indices of the points of coarser levels.
    predictors
        Result. Its `neighbours` are indices of points, not yet places in coding order.
    work
        Number of operations that the search may take.

    Returns
    -------
    int
        Number of operations left. If it is negative, there is no result.
    """
    same_level = order[part]
    scale = bias.astype(np.int32)
    placed = [points.positions[rows] for rows in (same_level, retained)]
    if options.mask_bits:
        placed = [rows >> options.mask_bits << options.mask_bits for rows in placed]
    same_level_boxes, coarser_boxes = (boxes(rows * scale) for rows in placed)
    codes, coarser_codes = points.codes[same_level], points.codes[retained]
    sized = not options.mask_bits
    is_sorted = sized and len(codes) > 1 and codes[0] != codes[-1]
    bits = _dense_cell_bits(codes, 4) if is_sorted else 0
    coarser_bits = _dense_cell_bits(coarser_codes, 2)
    of_coarser = coarser_codes, coarser_boxes.positions, bias
    of_level = codes, same_level_boxes.positions, bias
    nearest = np.empty((len(same_level), 3), dtype=np.int32)

    def work_of(points: tuple[int, int]) -> int:
        near, coarser_grid, same_level_grid = MEMORY.atlases
        level = Level(
            codes,
            same_level_boxes,
            coarser_boxes,
            grid(*of_coarser, near, options.cell_bits, False),
            grid(*of_coarser, coarser_grid, coarser_bits, sized),
            grid(*of_level, same_level_grid, bits, True, following=True),
        )
        return work - find_nearest(level, options, nearest, *points, work)

    parts = max(1, min(allowed_threads(), len(codes) // _LEAST_PART))
    edges = [len(codes) * k // parts for k in range(parts + 1)]
    work -= sum(in_threads(work_of, pairwise(edges)))
    if work >= 0:
        _write_predictors(
            options, points.positions, bias, order, part.start, retained, nearest, predictors
        )
    return work


@entry
def _write_predictors(
    options: SearchOptions,
    positions: Int32s,
    bias: Ints,
    order: Int32s,
    start: int,
    retained: Int32s,
    nearest: Int32s,
    predictors: Predictors,
) -> None:
    counts, neighbours, weights = predictors
    for i in range(len(nearest)):
        place = len(order) - 1 - start - i
        point = integer(order[start + i])
        count = integer(0)
        while count < options.most and nearest[i, count] >= 0:
            index = integer(nearest[i, count])
            in_level = index - len(retained)
            neighbour = integer(retained[index] if in_level < 0 else order[start + in_level])
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
def _sort_pair(neighbours: Int32s, weights: Ints, place: int, first: int) -> None:
    second = first + 1
    if weights[place, first] > weights[place, second]:
        weight, neighbour = weights[place, first], neighbours[place, first]
        weights[place, first] = weights[place, second]
        neighbours[place, first] = neighbours[place, second]
        weights[place, second], neighbours[place, second] = weight, neighbour

"""Coding of a leaf's plane: that of a leaf beside it, or new numbers predicted from it."""

from __future__ import annotations

import numpy as np

from puckbench.codecs.primitives.entropy import Coder, code_bit, code_number
from puckbench.codecs.primitives.layout import (
    Frame,
    Ints,
    Leaves,
    Nodes,
    Owners,
    dominant,
    owner_at,
)
from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import fit_plane, squared_distance

_CANDIDATES = 4
_LARGEST = 4
"""Times that a plane's precision may double."""
_NAMES = 64

# Where the contexts and the mixers of each kind begin, from those given.
_MERGE = 0
_AXIS = _MERGE + 192
_NUMBERS = _AXIS + 12
_LARGER = _NUMBERS + 40 * 3 * 18
CONTEXTS = _LARGER + 17 * 8
_MERGE_MIXER, _AXIS_MIXER, _NUMBER_MIXER, _LARGER_MIXER = 0, 4, 6, 18
MIXERS = 19


@compiled
def code_plane(
    coder: Coder,
    base: tuple[int, int],
    frame: Frame,
    level: int,
    node: Ints,
    nodes: Nodes,
    leaves: Leaves,
    owner: Owners,
) -> None:
    """Code the plane of a node that is a leaf and add it to the leaves.

    base: first context and mixer. node: (4,) place at its level and index among `nodes`. The
    encoder takes whatever costs least, error and estimated bits together.
    """
    down = frame.depth - level
    side = 1 << down
    corner = node[:3] << down
    found = np.zeros(_CANDIDATES, np.int64)
    count = _candidates(frame, corner, side, leaves, owner, found)
    cube = (corner.astype(np.float64) + side / 2, side / 2, frame.steps[level])
    predicted, wanted = np.zeros(4, np.int64), np.zeros(4, np.int64)
    chosen, larger, most = count, 0, max(min(_LARGEST, 15 - down), 0)
    if coder.bits.registers[4] == 1:
        moments = (nodes.moments[node[3]], nodes.wholes[node[3]])
        chosen, larger = _choice(frame, moments, leaves, found[:count], cube, most, wanted)
    chosen = _code_choice(coder, base, chosen, count, down)
    if chosen < count:
        name = found[chosen]
    else:
        larger = _code_larger(coder, base, larger, down, most)
        cube = _as_of(cube, larger)
        if count > 0:
            quantised(leaves.planes[found[0]], cube, predicted)
        _code_numbers(coder, base, wanted, predicted, count > 0, down + larger)
        name = leaves.counts[1]
        leaves.counts[1] += 1
        plane_from(wanted, cube, leaves.planes[name])
    _add_leaf(frame, corner, side, name, leaves, owner)


@compiled
def _add_leaf(
    frame: Frame, corner: Ints, side: int, name: int, leaves: Leaves, owner: Owners
) -> None:
    leaf = leaves.counts[0]
    leaves.counts[0] += 1
    leaves.corner[leaf] = corner
    leaves.side[leaf] = side
    leaves.plane[leaf] = name
    down = frame.depth - frame.finest
    low, high = corner >> down, (corner + side) >> down
    owner[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = leaf + 1


@compiled
def _candidates(
    frame: Frame, corner: Ints, side: int, leaves: Leaves, owner: Owners, found: Ints
) -> int:
    """Planes of the leaves around a cube that cross it, the one with most contact first."""
    votes, names = np.zeros(_NAMES, np.int64), np.zeros(_NAMES, np.int64)
    count = _contacts(frame, corner, side, leaves, owner, votes, names)
    kept = 0
    while kept < len(found):
        best = np.argmax(votes[:count]) if count else 0
        if votes[best] == 0:
            break
        votes[best] = 0
        if _crosses(frame, leaves.planes[names[best]], corner, side):
            found[kept] = names[best]
            kept += 1
    return kept


@compiled
def _contacts(
    frame: Frame,
    corner: Ints,
    side: int,
    leaves: Leaves,
    owner: Owners,
    votes: Ints,
    names: Ints,
) -> int:
    """Count the cells around a cube by the plane of the leaf they belong to; how many planes."""
    count = 0
    low = np.maximum(corner - 1, 0)
    high = np.minimum(corner + side, frame.shape - 1)
    for x in range(low[0], high[0] + 1):
        for y in range(low[1], high[1] + 1):
            inside = corner[0] <= x < corner[0] + side and corner[1] <= y < corner[1] + side
            for z in range(low[2], high[2] + 1):
                if inside and corner[2] <= z < corner[2] + side:
                    continue
                leaf = owner_at(frame, owner, x, y, z) - 1
                if leaf >= 0:
                    count = _vote(leaves.plane[leaf], count, votes, names)
    return count


@compiled
def _vote(name: int, count: int, votes: Ints, names: Ints) -> int:
    for k in range(count):
        if names[k] == name:
            votes[k] += 1
            return count
    if count == _NAMES:
        return count
    names[count] = name
    votes[count] = 1
    return count + 1


@compiled
def _crosses(frame: Frame, plane: Floats, corner: Ints, side: int) -> bool:
    """Whether a plane crosses a cube, or misses it by no more than a least leaf."""
    half = side / 2
    reach = half * (abs(plane[0]) + abs(plane[1]) + abs(plane[2]))
    off = -plane[3]
    for k in range(3):
        off += plane[k] * (corner[k] + half)
    return bool(abs(off) <= reach + (1 << (frame.depth - frame.finest)))


@compiled
def _as_of(cube: tuple[Floats, float, float], larger: int) -> tuple[Floats, float, float]:
    """The cube with the precision of one whose side is 2^larger times as long."""
    return cube[0], cube[1] * 2.0**larger, cube[2] * 2.0 ** (-0.5 * larger)


@compiled
def _choice(
    frame: Frame,
    moments: tuple[Floats, Floats],
    leaves: Leaves,
    found: Ints,
    cube: tuple[Floats, float, float],
    most: int,
    wanted: Ints,
) -> tuple[int, int]:
    """Index of the neighbour's plane that costs least; len(found) for a new one, into `wanted`.

    moments: of the leaf and of its region, whose plane a new one is. The second number is how
    precise that is to be.
    """
    plane = np.empty(4)
    larger, bits = _new_plane(frame, moments[1], leaves, found, cube, most, wanted, plane)
    best, least = len(found), squared_distance(moments[0], plane) + frame.price * bits
    for k in range(len(found)):
        cost = squared_distance(moments[0], leaves.planes[found[k]]) + frame.price * (1 + k)
        if cost < least:
            best, least = k, cost
    return best, larger


@compiled
def _new_plane(
    frame: Frame,
    region: Floats,
    leaves: Leaves,
    found: Ints,
    cube: tuple[Floats, float, float],
    most: int,
    wanted: Ints,
    plane: Floats,
) -> tuple[int, float]:
    """Write a region's plane at the precision where it costs least; that, and bits, about."""
    fitted, tried = np.empty(4), np.empty(4)
    fit_plane(region, fitted)
    numbers, predicted = np.zeros(4, np.int64), np.zeros(4, np.int64)
    least, best, fewest = np.inf, 0, 0.0
    for larger in range(most + 1):
        finer = _as_of(cube, larger)
        quantised(fitted, finer, numbers)
        if len(found) > 0:
            quantised(leaves.planes[found[0]], finer, predicted)
        plane_from(numbers, finer, tried)
        bits = larger + (3.0 if numbers[0] == predicted[0] else 6.0)
        for k in range(1, 4):
            bits += 1.0 + 2.0 * np.log2(1.0 + abs(numbers[k] - predicted[k]))
        cost = squared_distance(region, tried) + frame.price * bits
        if cost < least:
            least, best, fewest = cost, larger, bits
            wanted[:] = numbers
            plane[:] = tried
    return best, fewest


@compiled
def _code_choice(coder: Coder, base: tuple[int, int], chosen: int, count: int, down: int) -> int:
    at, mixer = base[0] + _MERGE, base[1] + _MERGE_MIXER
    for k in range(count):
        contexts = (at + 16 * k + min(down, 15), at + 64 + 8 * k + count, at + 128 + k)
        if code_bit(coder, 1 if chosen == k else 0, mixer + k, contexts) == 1:
            return k
    return count


@compiled
def _code_larger(coder: Coder, base: tuple[int, int], larger: int, down: int, most: int) -> int:
    """Code as of how much larger a cube a plane is precise: a power of two, up to `most`."""
    at, mixer = base[0] + _LARGER, base[1] + _LARGER_MIXER
    for size in range(most):
        by_size = at + 8 * min(down, 15) + size
        contexts = (by_size, by_size, at + 128 + size)
        if code_bit(coder, 1 if larger > size else 0, mixer, contexts) == 0:
            return size
    return most


@compiled
def _code_numbers(
    coder: Coder,
    base: tuple[int, int],
    wanted: Ints,
    predicted: Ints,
    has_prediction: bool,
    down: int,
) -> None:
    """Code axis, height and slopes of a plane; `wanted` becomes what was read."""
    known = 1 if has_prediction else 0
    wanted[0] = _code_axis(coder, base, wanted[0], predicted[0], known)
    fit = 1 if known and wanted[0] == predicted[0] else 0
    at = base[0] + _NUMBERS
    for k in range(3):
        guess = predicted[k + 1] if fit else 0
        by_size = at + 40 * (3 * min(down, 15) + k)
        by_kind = at + 40 * (48 + 3 * fit + k)
        mixer = base[1] + _NUMBER_MIXER + 3 * (k > 0) + 6 * fit
        number = code_number(coder, wanted[k + 1] - guess, mixer, by_size, by_kind)
        wanted[k + 1] = guess + number


@compiled
def _code_axis(coder: Coder, base: tuple[int, int], axis: int, expected: int, known: int) -> int:
    at, mixer = base[0] + _AXIS + 6 * known, base[1] + _AXIS_MIXER
    if code_bit(coder, 1 if axis == expected else 0, mixer, (at, at + 1, at + 1)) == 1:
        return expected
    following = (expected + 1) % 3
    bit = code_bit(coder, 1 if axis == following else 0, mixer + 1, (at + 2, at + 3, at + 3))
    return following if bit == 1 else (expected + 2) % 3


@compiled
def quantised(plane: Floats, cube: tuple[Floats, float, float], numbers: Ints) -> None:
    """Write (4,) axis, height at the centre and slopes across half the cube, in steps.

    cube: centre (3,), half its side, step.
    """
    centre, half, step = cube
    axis = dominant(plane)
    off = plane[3] - plane[0] * centre[0] - plane[1] * centre[1] - plane[2] * centre[2]
    numbers[0] = axis
    numbers[1] = int(np.rint(off / plane[axis] / step))
    for k in range(1, 3):
        slope = -plane[(axis + k) % 3] / plane[axis]
        numbers[1 + k] = int(np.rint(slope * half / step))


@compiled
def plane_from(numbers: Ints, cube: tuple[Floats, float, float], plane: Floats) -> None:
    """Write the plane (4,) of the numbers that `quantised` makes."""
    centre, half, step = cube
    axis = numbers[0]
    a, b = -numbers[2] * step / half, -numbers[3] * step / half
    length = np.sqrt(1 + a * a + b * b)
    plane[axis], plane[(axis + 1) % 3], plane[(axis + 2) % 3] = 1 / length, a / length, b / length
    off = plane[axis] * numbers[1] * step
    plane[3] = off + plane[0] * centre[0] + plane[1] * centre[1] + plane[2] * centre[2]

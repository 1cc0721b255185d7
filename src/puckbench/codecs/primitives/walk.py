"""Coding of the octree's structure and of its leaves' planes, the same way in both directions.

Level by level, coarse first: each node is a leaf or is split; a leaf's plane is that of a
neighbour, or new and predicted from a neighbour's. The encoder chooses as it goes, for what
neighbours look like is only known then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.primitives.entropy import Coder, code_bit, code_number
from puckbench.codecs.primitives.moments import fit_plane, squared_distance
from puckbench.metrics.compiled import compiled

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

UNKNOWN, EMPTY, FULL, SPLIT = 0, 1, 2, 3
CANDIDATES = 4

# Where the contexts of each kind begin.
_FACES = 0
_SIBLINGS = _FACES + 729
_COUNTS = _SIBLINGS + 8 * 128
_LEAF = _COUNTS + 16 * 12
_MERGE = _LEAF + 49 + 2 * 16
_AXIS = _MERGE + 192
_NUMBERS = _AXIS + 12
CONTEXTS = _NUMBERS + 40 * 3 * 18
MIXERS = 34


class Nodes(NamedTuple):
    """What the encoder knows of the nodes of all levels, one level after the other.

    moments: (n, 10). first: (n + 1,) children's place in the list; leaf: (n,).
    octant: (n,) of a node in its parent.
    """

    moments: Floats
    first: Ints
    leaf: NDArray[np.bool_]
    octant: Ints


class Leaves(NamedTuple):
    """Leaves in the order of coding: corner (n, 3) and side (n,) in cells, plane (n,) index.

    planes: (m, 4), n.p = d. counts: (2,) how many leaves and planes.
    """

    corner: Ints
    side: Ints
    plane: Ints
    planes: Floats
    counts: Ints


class Frame(NamedTuple):
    """depth: level of the cells; finest, coarsest: levels of leaves. cell: side of the finest. shape: (3,) cells. steps: (levels,)."""

    depth: int
    finest: int
    coarsest: int
    cell: float
    shape: Ints
    steps: Floats
    price: float


@compiled
def code_tree(coder: Coder, frame: Frame, nodes: Nodes, leaves: Leaves, owner: Ints) -> bool:
    """Code all levels; false when a stream has more nodes or leaves than there is room for."""
    writing = coder.registers[4] == 1
    room = len(leaves.side)
    here, there = np.zeros((room, 4), np.int64), np.zeros((room, 4), np.int64)
    count = 1
    states = np.full((3, 3, 3), 1, np.uint8)
    states[1, 1, 1] = 2
    for level in range(frame.finest + 1):
        for i in range(count):
            leaf = _code_leaf(coder, frame, level, here[i], states, nodes)
            if leaf:
                if leaves.counts[0] >= room:
                    return False
                _code_plane(coder, frame, level, here[i], nodes, leaves, owner)
                here[i, 3] = -1 - here[i, 3]
            else:
                states[here[i, 0] + 1, here[i, 1] + 1, here[i, 2] + 1] = 3
        if level == frame.finest:
            break
        finer = _finer_states(frame, level + 1, leaves)
        made = 0
        for i in range(count):
            if here[i, 3] < 0:
                continue
            if made + 8 > room:
                return False
            made = _code_children(coder, frame, level, here[i], states, finer, nodes, there, made)
        here, there = there, here
        count = made
        states = finer
    return True


@compiled
def _finer_states(frame: Frame, level: int, leaves: Leaves) -> Bytes:
    """States of the cells of a level that leaves coded so far tell: their planes cross or not."""
    down = frame.depth - level
    shape = ((frame.shape - 1) >> down) + 3
    states = np.zeros((shape[0], shape[1], shape[2]), np.uint8)
    half = frame.cell * (1 << down) / 2
    for i in range(leaves.counts[0]):
        plane = leaves.planes[leaves.plane[i]]
        reach = half * (abs(plane[0]) + abs(plane[1]) + abs(plane[2]))
        low = leaves.corner[i] >> down
        high = np.minimum((leaves.corner[i] + leaves.side[i]) >> down, shape - 2)
        for x in range(low[0], high[0]):
            for y in range(low[1], high[1]):
                for z in range(low[2], high[2]):
                    off = plane[0] * (2 * x + 1) + plane[1] * (2 * y + 1) + plane[2] * (2 * z + 1)
                    crossed = abs(off * half - plane[3]) <= reach
                    states[x + 1, y + 1, z + 1] = 2 if crossed else 1
    return states


@compiled
def _code_leaf(
    coder: Coder, frame: Frame, level: int, node: Ints, states: Bytes, nodes: Nodes
) -> bool:
    if level == frame.finest:
        return True
    if level < frame.coarsest:
        return False
    full = split = 0
    for axis in range(3):
        for side in range(-1, 2, 2):
            at = (node[0] + 1, node[1] + 1, node[2] + 1)
            if axis == 0:
                state = states[at[0] + side, at[1], at[2]]
            elif axis == 1:
                state = states[at[0], at[1] + side, at[2]]
            else:
                state = states[at[0], at[1], at[2] + side]
            full += state == 2
            split += state == 3
    leaf = 0
    if coder.registers[4] == 1:
        leaf = 1 if nodes.leaf[node[3]] else 0
    size = min(frame.depth - level, 15)
    return bool(
        code_bit(coder, leaf, 0, _LEAF + 7 * full + split, _LEAF + 49 + size, _LEAF + 65 + size) == 1
    )


@compiled
def _child_state(states: Bytes, finer: Bytes, x: int, y: int, z: int) -> int:
    """0 empty, 1 unknown in an occupied parent, 2 occupied."""
    if (
        x < 0
        or y < 0
        or z < 0
        or x + 2 >= finer.shape[0]
        or y + 2 >= finer.shape[1]
        or z + 2 >= finer.shape[2]
    ):
        return 0
    state = finer[x + 1, y + 1, z + 1]
    if state == 0:
        parent = states[(x >> 1) + 1, (y >> 1) + 1, (z >> 1) + 1]
        return 1 if parent >= 2 else 0
    return 2 if state >= 2 else 0


@compiled
def _code_children(
    coder: Coder,
    frame: Frame,
    level: int,
    node: Ints,
    states: Bytes,
    finer: Bytes,
    nodes: Nodes,
    there: Ints,
    made: int,
) -> int:
    """Code which children of a split node are occupied, and list them; the new length."""
    writing = coder.registers[4] == 1
    pattern, found = 0, 0
    child = 0
    last = 0
    if writing:
        child, last = nodes.first[node[3]], nodes.first[node[3] + 1]
    down = frame.depth - level - 1
    for octant in range(8):
        x = 2 * node[0] + (octant >> 2)
        y = 2 * node[1] + ((octant >> 1) & 1)
        z = 2 * node[2] + (octant & 1)
        if (
            (x << down) >= frame.shape[0]
            or (y << down) >= frame.shape[1]
            or (z << down) >= frame.shape[2]
        ):
            continue
        bit = 1 if writing and child < last and nodes.octant[child] == octant else 0
        bit = _code_occupancy(coder, bit, (x, y, z), octant, pattern, states, finer, down)
        pattern |= bit << octant
        finer[x + 1, y + 1, z + 1] = 2 if bit else 1
        if bit:
            there[made, 0], there[made, 1], there[made, 2] = x, y, z
            there[made, 3] = child
            made += 1
            found += 1
            child += 1
    return made


@compiled
def _code_occupancy(
    coder: Coder,
    bit: int,
    at: tuple[int, int, int],
    octant: int,
    pattern: int,
    states: Bytes,
    finer: Bytes,
    down: int,
) -> int:
    x, y, z = at
    faces = 0
    for axis in range(3):
        for side in range(-1, 2, 2):
            dx = side if axis == 0 else 0
            dy = side if axis == 1 else 0
            dz = side if axis == 2 else 0
            faces = 3 * faces + _child_state(states, finer, x + dx, y + dy, z + dz)
    around = 0
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                around += _child_state(states, finer, x + dx, y + dy, z + dz) == 2
    siblings = _SIBLINGS + octant * 128 + (pattern & 127)
    counts = _COUNTS + 12 * min(down, 15) + min(around, 11)
    return code_bit(coder, bit, 1 + octant, _FACES + faces, siblings, counts)


@compiled
def _candidates(
    frame: Frame, corner: Ints, side: int, leaves: Leaves, owner: Ints, found: Ints
) -> int:
    """Planes of the leaves around a cube, the one with most contact first; how many."""
    votes = np.zeros(64, np.int64)
    names = np.zeros(64, np.int64)
    count = 0
    low = np.maximum(corner - 1, 0)
    high = np.minimum(corner + side, frame.shape - 1)
    for x in range(low[0], high[0] + 1):
        for y in range(low[1], high[1] + 1):
            inside = corner[0] <= x < corner[0] + side and corner[1] <= y < corner[1] + side
            z = low[2]
            while z <= high[2]:
                if inside and z == corner[2]:
                    z = corner[2] + side
                    continue
                leaf = owner[x, y, z] - 1
                z += 1
                if leaf < 0:
                    continue
                name = leaves.plane[leaf]
                k = 0
                while k < count and names[k] != name:
                    k += 1
                if k == count:
                    if count == 64:
                        continue
                    names[k] = name
                    count += 1
                votes[k] += 1
    centre = (corner + side / 2) * frame.cell
    half = side * frame.cell / 2
    kept = 0
    for _ in range(count):
        best = -1
        for k in range(count):
            if votes[k] > 0 and (best < 0 or votes[k] > votes[best]):
                best = k
        if best < 0 or kept == len(found):
            break
        votes[best] = 0
        plane = leaves.planes[names[best]]
        reach = half * (abs(plane[0]) + abs(plane[1]) + abs(plane[2])) + frame.cell * (1 << (frame.depth - frame.finest))
        off = plane[0] * centre[0] + plane[1] * centre[1] + plane[2] * centre[2] - plane[3]
        if abs(off) <= reach:
            found[kept] = names[best]
            kept += 1
    return kept


@compiled
def _code_plane(
    coder: Coder, frame: Frame, level: int, node: Ints, nodes: Nodes, leaves: Leaves, owner: Ints
) -> None:
    writing = coder.registers[4] == 1
    down = frame.depth - level
    side = 1 << down
    corner = node[:3] << down
    found = np.zeros(4, np.int64)
    count = _candidates(frame, corner, side, leaves, owner, found)
    centre, half = (corner + side / 2) * frame.cell, side * frame.cell / 2
    step = frame.steps[level]
    predicted = np.zeros(4, np.int64)
    if count > 0:
        _quantised(leaves.planes[found[0]], centre, half, step, predicted)
    chosen, wanted = count, np.zeros(4, np.int64)
    if writing:
        chosen = _choice(frame, node, nodes, leaves, found[:count], (centre, half, step), predicted, wanted)
    merged = count
    for k in range(count):
        bit = code_bit(
            coder, 1 if chosen == k else 0, 10 + k,
            _MERGE + 16 * k + min(down, 15), _MERGE + 64 + 8 * k + count, _MERGE + 128 + k,
        )
        if bit == 1:
            merged = k
            break
    leaf = leaves.counts[0]
    if merged < count:
        name = found[merged]
    else:
        _code_parameters(coder, wanted, predicted, count > 0, down)
        name = leaves.counts[1]
        leaves.counts[1] += 1
        _plane_from(wanted, centre, half, step, leaves.planes[name])
    leaves.corner[leaf] = corner
    leaves.side[leaf] = side
    leaves.plane[leaf] = name
    leaves.counts[0] += 1
    high = np.minimum(corner + side, frame.shape)
    owner[corner[0] : high[0], corner[1] : high[1], corner[2] : high[2]] = leaf + 1


@compiled
def _choice(
    frame: Frame,
    node: Ints,
    nodes: Nodes,
    leaves: Leaves,
    found: Ints,
    cube: tuple[Floats, float, float],
    predicted: Ints,
    wanted: Ints,
) -> int:
    """Index of the neighbour's plane that costs least, or len(found) and the new plane's numbers."""
    moments = nodes.moments[node[3]]
    plane = np.empty(4)
    fit_plane(moments, plane)
    _quantised(plane, cube[0], cube[1], cube[2], wanted)
    _plane_from(wanted, cube[0], cube[1], cube[2], plane)
    bits = 3.0
    for k in range(3):
        bits += 1.0 + 2.0 * np.log2(1.0 + abs(wanted[k + 1] - predicted[k + 1]))
    if wanted[0] != predicted[0]:
        bits += 3
    best, least = len(found), squared_distance(moments, plane) + frame.price * bits
    for k in range(len(found)):
        cost = squared_distance(moments, leaves.planes[found[k]]) + frame.price * (1 + k)
        if cost < least:
            best, least = k, cost
    return best


@compiled
def _code_parameters(
    coder: Coder, wanted: Ints, predicted: Ints, has_prediction: bool, down: int
) -> None:
    """Code axis, height and slopes of a plane; `wanted` becomes what was read."""
    known = 1 if has_prediction else 0
    expected = predicted[0] if known else 0
    at = _AXIS + 6 * known
    same = code_bit(coder, 1 if wanted[0] == expected else 0, 20, at, at + 1, at + 1)
    if same == 0:
        second = code_bit(
            coder, 1 if wanted[0] == (expected + 1) % 3 else 0, 21, at + 2, at + 3, at + 3
        )
        wanted[0] = (expected + (1 if second == 1 else 2)) % 3
    else:
        wanted[0] = expected
    fit = 1 if known and same == 1 else 0
    for k in range(3):
        guess = predicted[k + 1] if fit else 0
        by_size = _NUMBERS + 40 * (3 * min(down, 15) + k)
        by_kind = _NUMBERS + 40 * (48 + 3 * fit + k)
        wanted[k + 1] = guess + code_number(
            coder, wanted[k + 1] - guess, 22 + 3 * (k > 0) + 6 * fit, by_size, by_kind
        )


@compiled
def _quantised(plane: Floats, centre: Floats, half: float, step: float, numbers: Ints) -> None:
    """Axis, height at the centre and slopes across half the cube, in steps."""
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    u, v = (axis + 1) % 3, (axis + 2) % 3
    off = plane[3] - plane[0] * centre[0] - plane[1] * centre[1] - plane[2] * centre[2]
    numbers[0] = axis
    numbers[1] = int(np.rint(off / plane[axis] / step))
    numbers[2] = int(np.rint(-plane[u] / plane[axis] * half / step))
    numbers[3] = int(np.rint(-plane[v] / plane[axis] * half / step))


@compiled
def _plane_from(numbers: Ints, centre: Floats, half: float, step: float, plane: Floats) -> None:
    axis = numbers[0]
    u, v = (axis + 1) % 3, (axis + 2) % 3
    a, b = -numbers[2] * step / half, -numbers[3] * step / half
    length = np.sqrt(1 + a * a + b * b)
    plane[axis], plane[u], plane[v] = 1 / length, a / length, b / length
    plane[3] = (
        plane[0] * centre[0]
        + plane[1] * centre[1]
        + plane[2] * centre[2]
        + plane[axis] * numbers[1] * step
    )

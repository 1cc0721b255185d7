"""Coding of the octree, level by level, coarse first, the same way in both directions.

A node is a leaf, with a plane, or is split. The encoder chooses planes as it goes, for what
neighbours look like is only known then.
"""

from __future__ import annotations

import numpy as np

from puckbench.codecs.primitives.entropy import Coder, code_bit
from puckbench.codecs.primitives.layout import Bytes, Frame, Ints, Leaves, Nodes, Owners
from puckbench.codecs.primitives.planes import CONTEXTS as PLANE_CONTEXTS
from puckbench.codecs.primitives.planes import MIXERS as PLANE_MIXERS
from puckbench.codecs.primitives.planes import code_plane
from puckbench.core.compiling import compiled, compiled_in_place

# States of the nodes of a level.
_UNKNOWN, _EMPTY, _FULL, _SPLIT = 0, 1, 2, 3

# Where the contexts and the mixers of each kind begin.
_FACES = 0
_SIBLINGS = _FACES + 729
_COUNTS = _SIBLINGS + 8 * 128
_LEAF = _COUNTS + 16 * 12
_PLANES = _LEAF + 49 + 2 * 16
CONTEXTS = _PLANES + PLANE_CONTEXTS
_LEAF_MIXER, _OCTANT_MIXER, _PLANE_MIXER = 0, 1, 9
MIXERS = _PLANE_MIXER + PLANE_MIXERS


@compiled
def code_tree(coder: Coder, frame: Frame, nodes: Nodes, leaves: Leaves, owner: Owners) -> bool:
    """Code all levels; false when a stream has more nodes or leaves than there is room for.

    owner: grid of the least leaves, 0 or the leaf that has it and 1. What is coded is written to
    `leaves` and `owner`. `nodes` is only looked at by the encoder.
    """
    room = len(leaves.side)
    here, there = np.zeros((room, 4), np.int64), np.zeros((room, 4), np.int64)
    count = 1
    states = np.full((3, 3, 3), _EMPTY, np.uint8)
    states[1, 1, 1] = _FULL
    for level in range(frame.finest + 1):
        if not _code_leaves(coder, frame, level, here[:count], states, nodes, leaves, owner):
            return False
        if level < frame.finest:
            finer = _finer_states(frame, level + 1, leaves)
            levels = (states, finer)
            count = _code_splits(coder, frame, level, here[:count], levels, nodes, there)
            if count < 0:
                return False
            here, there = there, here
            states = finer
    return True


@compiled
def _code_leaves(
    coder: Coder,
    frame: Frame,
    level: int,
    here: Ints,
    states: Bytes,
    nodes: Nodes,
    leaves: Leaves,
    owner: Owners,
) -> bool:
    """Code which nodes of a level are leaves, and their planes; leaves get a negative index."""
    for i in range(len(here)):
        node = here[i]
        if not _code_leaf_flag(coder, frame, level, node, states, nodes):
            states[node[0] + 1, node[1] + 1, node[2] + 1] = _SPLIT
            continue
        if leaves.counts[0] >= len(leaves.side):
            return False
        code_plane(coder, (_PLANES, _PLANE_MIXER), frame, level, node, nodes, leaves, owner)
        node[3] = -1
    return True


@compiled_in_place
def _code_splits(
    coder: Coder,
    frame: Frame,
    level: int,
    here: Ints,
    levels: tuple[Bytes, Bytes],
    nodes: Nodes,
    there: Ints,
) -> int:
    """List the children of a level's split nodes; how many, -1 when there is no room."""
    made = 0
    for i in range(len(here)):
        if here[i, 3] >= 0:
            if made + 8 > len(there):
                return -1
            made = _code_children(coder, frame, level, here[i], levels, nodes, there, made)
    return made


@compiled
def _finer_states(frame: Frame, level: int, leaves: Leaves) -> Bytes:
    """States of a level's cells within leaves coded so far: whether their planes cross them."""
    down = frame.depth - level
    shape = ((frame.shape - 1) >> down) + 3
    states = np.zeros((shape[0], shape[1], shape[2]), np.uint8)
    half = (1 << down) / 2
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
                    states[x + 1, y + 1, z + 1] = _FULL if crossed else _EMPTY
    return states


@compiled_in_place
def _code_leaf_flag(
    coder: Coder, frame: Frame, level: int, node: Ints, states: Bytes, nodes: Nodes
) -> bool:
    """Code whether a node is a leaf, in the context of the six nodes beside it."""
    if level == frame.finest or level < frame.coarsest:
        return level == frame.finest
    full = split = 0
    for axis in range(3):
        for side in range(0, 3, 2):
            x = node[0] + (side if axis == 0 else 1)
            y = node[1] + (side if axis == 1 else 1)
            z = node[2] + (side if axis == 2 else 1)
            full += states[x, y, z] == _FULL
            split += states[x, y, z] == _SPLIT
    leaf = 1 if coder.bits.registers[4] == 1 and nodes.leaf[node[3]] else 0
    size = min(frame.depth - level, 15)
    contexts = (_LEAF + 7 * full + split, _LEAF + 49 + size, _LEAF + 65 + size)
    return bool(code_bit(coder, leaf, _LEAF_MIXER, contexts) == 1)


@compiled_in_place
def _code_children(
    coder: Coder,
    frame: Frame,
    level: int,
    node: Ints,
    levels: tuple[Bytes, Bytes],
    nodes: Nodes,
    there: Ints,
    made: int,
) -> int:
    """Code which children of a split node are occupied, and list them; the new length."""
    writing = coder.bits.registers[4] == 1
    child, end = (nodes.first[node[3]], nodes.first[node[3] + 1]) if writing else (0, 0)
    down = frame.depth - level - 1
    pattern = 0
    for octant in range(8):
        x = 2 * node[0] + (octant >> 2)
        y = 2 * node[1] + ((octant >> 1) & 1)
        z = 2 * node[2] + (octant & 1)
        if x << down >= frame.shape[0] or y << down >= frame.shape[1]:
            continue
        if z << down >= frame.shape[2]:
            continue
        bit = 1 if child < end and nodes.octant[child] == octant else 0
        bit = _code_occupancy(coder, bit, (x, y, z), (octant, pattern, down), levels)
        pattern |= bit << octant
        levels[1][x + 1, y + 1, z + 1] = _FULL if bit else _EMPTY
        if bit:
            there[made, 0], there[made, 1], there[made, 2], there[made, 3] = x, y, z, child
            made += 1
            child += 1
    return made


@compiled_in_place
def _code_occupancy(
    coder: Coder,
    bit: int,
    at: tuple[int, int, int],
    place: tuple[int, int, int],
    levels: tuple[Bytes, Bytes],
) -> int:
    """Code whether a child is occupied. place: octant, siblings so far, levels down to cells."""
    faces = around = 0
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                state = _child_state(levels, at[0] + dx, at[1] + dy, at[2] + dz)
                around += state == 2
                if abs(dx) + abs(dy) + abs(dz) == 1:
                    faces = 3 * faces + state
    octant, pattern, down = place
    siblings = _SIBLINGS + octant * 128 + (pattern & 127)
    counts = _COUNTS + 12 * min(down, 15) + min(around, 11)
    return code_bit(coder, bit, _OCTANT_MIXER + octant, (_FACES + faces, siblings, counts))


@compiled_in_place
def _child_state(levels: tuple[Bytes, Bytes], x: int, y: int, z: int) -> int:
    """0 empty, 1 not known but the parent is occupied, 2 occupied."""
    states, finer = levels
    if min(x, y, z) < 0 or x + 2 >= finer.shape[0]:
        return 0
    if y + 2 >= finer.shape[1] or z + 2 >= finer.shape[2]:
        return 0
    state = finer[x + 1, y + 1, z + 1]
    if state == _UNKNOWN:
        parent = states[(x >> 1) + 1, (y >> 1) + 1, (z >> 1) + 1]
        return 1 if parent >= _FULL else 0
    return 2 if state >= _FULL else 0

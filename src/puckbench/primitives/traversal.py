"""Tree traversal: codes the octree of planes level by level, coarse first, in both directions.

A node is a leaf, which has a plane, or is split. The encoder chooses planes while it traverses,
because the neighbours that they are predicted from are only known then.
"""

from __future__ import annotations

import numpy as np

from puckbench.coding.binary_coder import exhausted
from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.primitives.entropy import Coder, code_bit
from puckbench.primitives.octree_arrays import (
    Bytes,
    Ints,
    LeafMap,
    Leaves,
    Nodes,
    OctreeGeometry,
)
from puckbench.primitives.plane_coding import CONTEXTS as PLANE_CONTEXTS
from puckbench.primitives.plane_coding import MIXERS as PLANE_MIXERS
from puckbench.primitives.plane_coding import code_plane
from puckbench.primitives.stream import MAX_NODES

# States of the nodes of a level.
_UNKNOWN, _EMPTY, _OCCUPIED, _SPLIT = 0, 1, 2, 3

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
def code_octree(
    coder: Coder, geometry: OctreeGeometry, nodes: Nodes, leaves: Leaves, leaf_map: LeafMap
) -> bool:
    """Code all levels of the octree.

    Parameters
    ----------
    coder
        Writes or reads.
    geometry
        Geometry of the octree.
    nodes
        What the encoder knows of the nodes; not used in decoding.
    leaves
        Receives corner, side and plane of each leaf.
    leaf_map
        Grid of the smallest leaves: receives the index + 1 of the leaf that a cell belongs to.

    Returns
    -------
    bool
        False if there are more leaves than there is room for, more nodes than `MAX_NODES`, or a
        stream ends too early.
    """
    capacity = len(leaves.side)
    nodes_here, children = np.zeros((capacity, 4), np.int64), np.zeros((capacity, 4), np.int64)
    count = nodes_so_far = 1
    states = np.full((3, 3, 3), _EMPTY, np.uint8)
    states[1, 1, 1] = _OCCUPIED
    for level in range(geometry.finest_leaf_level + 1):
        if not _code_leaves(
            coder, geometry, level, nodes_here[:count], states, nodes, leaves, leaf_map
        ):
            return False
        if level < geometry.finest_leaf_level:
            child_states = _states_of_planes(geometry, level + 1, leaves)
            states_of_levels = (states, child_states)
            count = _code_splits(
                coder, geometry, level, nodes_here[:count], states_of_levels, nodes, children
            )
            nodes_so_far += count
            if count < 0 or nodes_so_far > MAX_NODES:
                return False
            nodes_here, children = children, nodes_here
            states = child_states
    return True


@compiled
def _code_leaves(
    coder: Coder,
    geometry: OctreeGeometry,
    level: int,
    nodes_here: Ints,
    states: Bytes,
    nodes: Nodes,
    leaves: Leaves,
    leaf_map: LeafMap,
) -> bool:
    """Code which nodes of a level are leaves, and their planes; leaves get index -1."""
    for i in range(len(nodes_here)):
        node = nodes_here[i]
        if not _code_is_leaf(coder, geometry, level, node, states, nodes):
            states[node[0] + 1, node[1] + 1, node[2] + 1] = _SPLIT
            continue
        if leaves.counts[0] >= len(leaves.side) or exhausted(coder.bits):
            return False
        code_plane(coder, (_PLANES, _PLANE_MIXER), geometry, level, node, nodes, leaves, leaf_map)
        node[3] = -1
    return True


@compiled_in_place
def _code_splits(
    coder: Coder,
    geometry: OctreeGeometry,
    level: int,
    nodes_here: Ints,
    states_of_levels: tuple[Bytes, Bytes],
    nodes: Nodes,
    children: Ints,
) -> int:
    """List the children of a level's split nodes; their number, -1 where a stream has too many."""
    count = 0
    for i in range(len(nodes_here)):
        if nodes_here[i, 3] >= 0:
            if count + 8 > len(children) or exhausted(coder.bits):
                return -1
            count = _code_children(
                coder, geometry, level, nodes_here[i], states_of_levels, nodes, children, count
            )
    return count


@compiled
def _states_of_planes(geometry: OctreeGeometry, level: int, leaves: Leaves) -> Bytes:
    """States of a level's cells within the leaves so far: whether the planes cross them."""
    down = geometry.depth - level
    shape = ((geometry.shape - 1) >> down) + 3
    states = np.zeros((shape[0], shape[1], shape[2]), np.uint8)
    half = (1 << down) / 2
    for i in range(leaves.counts[0]):
        plane = leaves.planes[leaves.plane_index[i]]
        half_extent = half * (abs(plane[0]) + abs(plane[1]) + abs(plane[2]))
        low = leaves.corner[i] >> down
        high = np.minimum((leaves.corner[i] + leaves.side[i]) >> down, shape - 2)
        for x in range(low[0], high[0]):
            for y in range(low[1], high[1]):
                for z in range(low[2], high[2]):
                    distance = (
                        plane[0] * (2 * x + 1) + plane[1] * (2 * y + 1) + plane[2] * (2 * z + 1)
                    )
                    crossed = abs(distance * half - plane[3]) <= half_extent
                    states[x + 1, y + 1, z + 1] = _OCCUPIED if crossed else _EMPTY
    return states


@compiled_in_place
def _code_is_leaf(
    coder: Coder, geometry: OctreeGeometry, level: int, node: Ints, states: Bytes, nodes: Nodes
) -> bool:
    """Code whether a node is a leaf, in the context of its six face neighbours."""
    if level == geometry.finest_leaf_level or level < geometry.coarsest_leaf_level:
        return level == geometry.finest_leaf_level
    occupied = split = 0
    for axis in range(3):
        for side in range(0, 3, 2):
            x = node[0] + (side if axis == 0 else 1)
            y = node[1] + (side if axis == 1 else 1)
            z = node[2] + (side if axis == 2 else 1)
            occupied += states[x, y, z] == _OCCUPIED
            split += states[x, y, z] == _SPLIT
    leaf = 1 if coder.bits.registers[4] == 1 and nodes.is_leaf[node[3]] else 0
    size = min(geometry.depth - level, 15)
    contexts = (_LEAF + 7 * occupied + split, _LEAF + 49 + size, _LEAF + 65 + size)
    return bool(code_bit(coder, leaf, _LEAF_MIXER, contexts) == 1)


@compiled_in_place
def _code_children(
    coder: Coder,
    geometry: OctreeGeometry,
    level: int,
    node: Ints,
    states_of_levels: tuple[Bytes, Bytes],
    nodes: Nodes,
    children: Ints,
    count: int,
) -> int:
    """Code which children of a split node are occupied, and list them; the new length."""
    writing = coder.bits.registers[4] == 1
    child, end = (nodes.first_child[node[3]], nodes.first_child[node[3] + 1]) if writing else (0, 0)
    down = geometry.depth - level - 1
    pattern = 0
    for octant in range(8):
        x = 2 * node[0] + (octant >> 2)
        y = 2 * node[1] + ((octant >> 1) & 1)
        z = 2 * node[2] + (octant & 1)
        if x << down >= geometry.shape[0] or y << down >= geometry.shape[1]:
            continue
        if z << down >= geometry.shape[2]:
            continue
        bit = 1 if child < end and nodes.octant[child] == octant else 0
        bit = _code_occupancy(coder, bit, (x, y, z), (octant, pattern, down), states_of_levels)
        pattern |= bit << octant
        states_of_levels[1][x + 1, y + 1, z + 1] = _OCCUPIED if bit else _EMPTY
        if bit:
            children[count, 0], children[count, 1], children[count, 2], children[count, 3] = (
                x,
                y,
                z,
                child,
            )
            count += 1
            child += 1
    return count


@compiled_in_place
def _code_occupancy(
    coder: Coder,
    bit: int,
    at: tuple[int, int, int],
    place: tuple[int, int, int],
    states_of_levels: tuple[Bytes, Bytes],
) -> int:
    """Code whether a child is occupied, in the context of its 26 neighbours as far as known.

    place: octant, siblings coded so far (a bit each), levels down to the cells.
    """
    faces = around = 0
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                state = _child_state(states_of_levels, at[0] + dx, at[1] + dy, at[2] + dz)
                around += state == 2
                if abs(dx) + abs(dy) + abs(dz) == 1:
                    faces = 3 * faces + state
    octant, pattern, down = place
    siblings = _SIBLINGS + octant * 128 + (pattern & 127)
    counts = _COUNTS + 12 * min(down, 15) + min(around, 11)
    return code_bit(coder, bit, _OCTANT_MIXER + octant, (_FACES + faces, siblings, counts))


@compiled_in_place
def _child_state(states_of_levels: tuple[Bytes, Bytes], x: int, y: int, z: int) -> int:
    """State of a place at the finer level: 0 empty, 1 within an occupied parent, 2 occupied."""
    states, child_states = states_of_levels
    if min(x, y, z) < 0 or x + 2 >= child_states.shape[0]:
        return 0
    if y + 2 >= child_states.shape[1] or z + 2 >= child_states.shape[2]:
        return 0
    state = child_states[x + 1, y + 1, z + 1]
    if state == _UNKNOWN:
        parent = states[(x >> 1) + 1, (y >> 1) + 1, (z >> 1) + 1]
        return 1 if parent >= _OCCUPIED else 0
    return 2 if state >= _OCCUPIED else 0

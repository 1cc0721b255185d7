"""Encoding and decoding of the octree of planes, level by level from the root.

Each occupied node is either a leaf with a plane, or is split into children. A leaf's plane is
predicted from planes that are already coded; therefore the encoder chooses planes during this
traversal.
"""

from __future__ import annotations

import numpy as np

from pointkit.coding.binary_coder import exhausted
from pointkit.compiling import compiled, compiled_in_place
from primitive_codec.entropy import ContextCoder, code_bit, is_writing
from primitive_codec.octree_arrays import Bytes, EncoderNodes, Ints, OctreeGeometry, PlaneOctree
from primitive_codec.plane_coding import CONTEXTS as PLANE_CONTEXTS
from primitive_codec.plane_coding import MIXERS as PLANE_MIXERS
from primitive_codec.plane_coding import code_plane
from primitive_codec.stream import MAX_NODES

# States of the nodes of a level.
_UNKNOWN, _EMPTY, _OCCUPIED, _SPLIT = 0, 1, 2, 3

# Index of the first context and of the first mixer of each kind of bit.
_FACES = PLANE_CONTEXTS
_SIBLINGS = _FACES + 729
_COUNTS = _SIBLINGS + 8 * 128
_LEAF = _COUNTS + 16 * 12
CONTEXTS = _LEAF + 49 + 2 * 16
_LEAF_MIXER, _OCTANT_MIXER = PLANE_MIXERS, PLANE_MIXERS + 1
MIXERS = _OCTANT_MIXER + 8


@compiled
def code_octree(coder: ContextCoder, octree: PlaneOctree, nodes: EncoderNodes) -> bool:
    """Encode or decode all levels of the octree, and fill `octree` with the leaves.

    Parameters
    ----------
    coder
        Arithmetic coder; its direction decides between encoding and decoding.
    octree
        An empty octree, to which leaves, planes and the grid of leaf indices are written.
    nodes
        The encoder's nodes; a decoder does not read them.

    Returns
    -------
    bool
        False if there are more leaves than `octree` has room for or more nodes than `MAX_NODES`, or
        if the stream ends early.
    """
    geometry, capacity = octree.geometry, len(octree.leaves.side)
    # A row is a node: its coordinates at its level, and its index in `nodes`.
    level_nodes, children = np.zeros((capacity, 4), np.int64), np.zeros((capacity, 4), np.int64)
    count = node_count = 1
    states = np.full((3, 3, 3), _EMPTY, np.uint8)
    states[1, 1, 1] = _OCCUPIED
    for level in range(geometry.finest_leaf_level + 1):
        if not _code_leaves(coder, octree, level, level_nodes[:count], states, nodes):
            return False
        if level < geometry.finest_leaf_level:
            child_states = _plane_crossings(octree, level + 1)
            level_states = (states, child_states)
            count = _code_splits(
                coder, geometry, level, level_nodes[:count], level_states, nodes, children
            )
            node_count += count
            if count < 0 or node_count > MAX_NODES:
                return False
            level_nodes, children = children, level_nodes
            states = child_states
    return True


@compiled
def _code_leaves(
    coder: ContextCoder, octree: PlaneOctree, level: int, level_nodes: Ints, states: Bytes,
    nodes: EncoderNodes,
) -> bool:  # fmt: skip
    """Encode or decode which nodes of a level are leaves, and the planes of these leaves."""
    # A leaf's index in `level_nodes` becomes -1.
    leaves = octree.leaves
    for i in range(len(level_nodes)):
        node = level_nodes[i]
        if not _code_is_leaf(coder, octree.geometry, level, node, states, nodes):
            states[node[0] + 1, node[1] + 1, node[2] + 1] = _SPLIT
            continue
        if leaves.counts[0] >= len(leaves.side) or exhausted(coder.bits):
            return False
        code_plane(coder, octree, level, node, nodes)
        node[3] = -1
    return True


@compiled_in_place
def _code_splits(
    coder: ContextCoder, geometry: OctreeGeometry, level: int, level_nodes: Ints,
    level_states: tuple[Bytes, Bytes], nodes: EncoderNodes, children: Ints,
) -> int:  # fmt: skip
    """Encode or decode the occupied children of the split nodes of a level."""
    # Return the number of children, or -1 if they are too many or the stream ends early.
    count, side_log2, is_writer = 0, geometry.depth - level - 1, is_writing(coder)
    for i in range(len(level_nodes)):
        node = level_nodes[i]
        if node[3] < 0:
            continue
        if count + 8 > len(children) or exhausted(coder.bits):
            return -1
        child = end = pattern = 0
        if is_writer:
            child, end = nodes.first_child[node[3]], nodes.first_child[node[3] + 1]
        for octant in range(8):
            x = 2 * node[0] + (octant >> 2)
            y = 2 * node[1] + ((octant >> 1) & 1)
            z = 2 * node[2] + (octant & 1)
            if x << side_log2 >= geometry.shape[0] or y << side_log2 >= geometry.shape[1]:
                continue
            if z << side_log2 >= geometry.shape[2]:
                continue
            bit = 1 if child < end and nodes.octant[child] == octant else 0
            bit = _code_occupancy(coder, bit, (x, y, z), (octant, pattern, side_log2), level_states)
            pattern |= bit << octant
            level_states[1][x + 1, y + 1, z + 1] = _OCCUPIED if bit else _EMPTY
            if bit:
                children[count, 0], children[count, 1] = x, y
                children[count, 2], children[count, 3] = z, child
                count += 1
                child += 1
    return count


@compiled
def _plane_crossings(octree: PlaneOctree, level: int) -> Bytes:
    geometry, leaves = octree.geometry, octree.leaves
    side_log2 = geometry.depth - level
    shape = ((geometry.shape - 1) >> side_log2) + 3
    states = np.zeros((shape[0], shape[1], shape[2]), np.uint8)
    half = (1 << side_log2) / 2
    for i in range(leaves.counts[0]):
        plane = leaves.planes[leaves.plane_index[i]]
        half_extent = half * (abs(plane[0]) + abs(plane[1]) + abs(plane[2]))
        low = leaves.corner[i] >> side_log2
        high = np.minimum((leaves.corner[i] + leaves.side[i]) >> side_log2, shape - 2)
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
    coder: ContextCoder,
    geometry: OctreeGeometry,
    level: int,
    node: Ints,
    states: Bytes,
    nodes: EncoderNodes,
) -> bool:
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
    is_leaf = 1 if is_writing(coder) and nodes.is_leaf[node[3]] else 0
    side_log2 = min(geometry.depth - level, 15)
    contexts = (_LEAF + 7 * occupied + split, _LEAF + 49 + side_log2, _LEAF + 65 + side_log2)
    return bool(code_bit(coder, is_leaf, _LEAF_MIXER, contexts) == 1)


@compiled_in_place
def _code_occupancy(
    coder: ContextCoder,
    bit: int,
    position: tuple[int, int, int],
    child: tuple[int, int, int],
    level_states: tuple[Bytes, Bytes],
) -> int:
    # `child` holds the octant, the bits of earlier siblings' occupancy, and log2 of the side.
    faces = occupied_count = 0
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                state = _child_state(
                    level_states, position[0] + dx, position[1] + dy, position[2] + dz
                )
                occupied_count += state == 2
                if abs(dx) + abs(dy) + abs(dz) == 1:
                    faces = 3 * faces + state
    octant, pattern, side_log2 = child
    siblings = _SIBLINGS + octant * 128 + (pattern & 127)
    counts = _COUNTS + 12 * min(side_log2, 15) + min(occupied_count, 11)
    return code_bit(coder, bit, _OCTANT_MIXER + octant, (_FACES + faces, siblings, counts))


@compiled_in_place
def _child_state(level_states: tuple[Bytes, Bytes], x: int, y: int, z: int) -> int:
    """Return 0 if a child is empty, 1 if its parent is coded later, and 2 if it is occupied."""
    states, child_states = level_states
    if min(x, y, z) < 0 or x + 2 >= child_states.shape[0]:
        return 0
    if y + 2 >= child_states.shape[1] or z + 2 >= child_states.shape[2]:
        return 0
    state = child_states[x + 1, y + 1, z + 1]
    if state == _UNKNOWN:
        parent = states[(x >> 1) + 1, (y >> 1) + 1, (z >> 1) + 1]
        return 1 if parent >= _OCCUPIED else 0
    return 2 if state >= _OCCUPIED else 0

"""Coding of a leaf's plane: merged with the plane of a neighbouring leaf, or predicted from it.

As in the merge mode of video codecs, the encoder may signal the index of a neighbour's plane. A new
plane is that of the leaf's whole region; how far the region reaches decides its precision.
"""

from __future__ import annotations

import numpy as np

from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import fit_plane, squared_distance
from puckbench.primitives.entropy import Coder, code_bit, code_number
from puckbench.primitives.octree_arrays import (
    Ints,
    LeafMap,
    Leaves,
    Nodes,
    OctreeGeometry,
    dominant_axis,
    leaf_at,
)

_CANDIDATES = 4
_MAX_REACH_LOG2 = 4
"""How often the reach of a plane, and thereby its precision, may double."""
_MAX_CONTACTS = 64

# Where the contexts and the mixers of each kind begin, from those given.
_MERGE = 0
_AXIS = _MERGE + 192
_PARAMETERS = _AXIS + 12
_REACH = _PARAMETERS + 40 * 3 * 18
CONTEXTS = _REACH + 17 * 8
_MERGE_MIXER, _AXIS_MIXER, _PARAMETER_MIXER, _REACH_MIXER = 0, 4, 6, 18
MIXERS = 19


@compiled
def code_plane(
    coder: Coder,
    base: tuple[int, int],
    geometry: OctreeGeometry,
    level: int,
    node: Ints,
    nodes: Nodes,
    leaves: Leaves,
    leaf_map: LeafMap,
) -> None:
    """Code the plane of a node that is a leaf, and add the leaf.

    The encoder takes the candidate of least squared distance + lmbda * estimated bits.

    Parameters
    ----------
    coder, base
        Writes or reads, with the contexts and mixers from the numbers `base` on.
    geometry, level, node
        The octree, the node's level, and (4,) its place there and its index in `nodes`.
    nodes
        What the encoder knows of the nodes; not used in decoding.
    leaves, leaf_map
        Receive the leaf.
    """
    down = geometry.depth - level
    side = 1 << down
    corner = node[:3] << down
    candidates = np.zeros(_CANDIDATES, np.int64)
    count = _candidates(geometry, corner, side, leaves, leaf_map, candidates)
    cube = (corner.astype(np.float64) + side / 2, side / 2, geometry.plane_steps[level])
    predicted, indices = np.zeros(4, np.int64), np.zeros(4, np.int64)
    merge_index, reach_log2, max_reach = count, 0, max(min(_MAX_REACH_LOG2, 15 - down), 0)
    if coder.bits.registers[4] == 1:
        moments = (nodes.moments[node[3]], nodes.region_moments[node[3]])
        merge_index, reach_log2 = _decide_plane(
            geometry, moments, leaves, candidates[:count], cube, max_reach, indices
        )
    merge_index = _code_merge_index(coder, base, merge_index, count, down)
    if merge_index < count:
        plane = candidates[merge_index]
    else:
        reach_log2 = _code_reach(coder, base, reach_log2, down, max_reach)
        cube = _with_reach(cube, reach_log2)
        if count > 0:
            quantise_plane(leaves.planes[candidates[0]], cube, predicted)
        _code_parameters(coder, base, indices, predicted, count > 0, down + reach_log2)
        plane = leaves.counts[1]
        leaves.counts[1] += 1
        dequantise_plane(indices, cube, leaves.planes[plane])
    _add_leaf(geometry, corner, side, plane, leaves, leaf_map)


@compiled_in_place
def _add_leaf(
    geometry: OctreeGeometry, corner: Ints, side: int, plane: int, leaves: Leaves, leaf_map: LeafMap
) -> None:
    """Append a leaf and enter it into the grid of the smallest leaves."""
    leaf = leaves.counts[0]
    leaves.counts[0] += 1
    for k in range(3):
        leaves.corner[leaf, k] = corner[k]
    leaves.side[leaf] = side
    leaves.plane_index[leaf] = plane
    down = geometry.depth - geometry.finest_leaf_level
    x, y, z, size = corner[0] >> down, corner[1] >> down, corner[2] >> down, side >> down
    leaf_map[x : x + size, y : y + size, z : z + size] = leaf + 1


@compiled
def _candidates(
    geometry: OctreeGeometry,
    corner: Ints,
    side: int,
    leaves: Leaves,
    leaf_map: LeafMap,
    candidates: Ints,
) -> int:
    """Merge candidates: planes of adjacent leaves that cross a cube, most contact first."""
    contacts, planes = np.zeros(_MAX_CONTACTS, np.int64), np.zeros(_MAX_CONTACTS, np.int64)
    count = _contacts(geometry, corner, side, leaves, leaf_map, contacts, planes)
    kept = 0
    while kept < len(candidates):
        best = np.argmax(contacts[:count]) if count else 0
        if contacts[best] == 0:
            break
        contacts[best] = 0
        if _is_near(geometry, leaves.planes[planes[best]], corner, side):
            candidates[kept] = planes[best]
            kept += 1
    return kept


@compiled_in_place
def _contacts(
    geometry: OctreeGeometry,
    corner: Ints,
    side: int,
    leaves: Leaves,
    leaf_map: LeafMap,
    contacts: Ints,
    planes: Ints,
) -> int:
    """Count the cells around a cube by the plane of their leaf; the number of planes."""
    count = 0
    for x in range(max(corner[0] - 1, 0), min(corner[0] + side + 1, geometry.shape[0])):
        for y in range(max(corner[1] - 1, 0), min(corner[1] + side + 1, geometry.shape[1])):
            inside = corner[0] <= x < corner[0] + side and corner[1] <= y < corner[1] + side
            for z in range(max(corner[2] - 1, 0), min(corner[2] + side + 1, geometry.shape[2])):
                if inside and corner[2] <= z < corner[2] + side:
                    continue
                leaf = leaf_at(geometry, leaf_map, x, y, z) - 1
                if leaf >= 0:
                    count = _count_contact(leaves.plane_index[leaf], count, contacts, planes)
    return count


@compiled_in_place
def _count_contact(plane: int, count: int, contacts: Ints, planes: Ints) -> int:
    for k in range(count):
        if planes[k] == plane:
            contacts[k] += 1
            return count
    if count == _MAX_CONTACTS:
        return count
    planes[count] = plane
    contacts[count] = 1
    return count + 1


@compiled_in_place
def _is_near(geometry: OctreeGeometry, plane: Floats, corner: Ints, side: int) -> bool:
    """Whether a plane crosses a cube, or misses it by at most the side of a smallest leaf."""
    half = side / 2
    half_extent = half * (abs(plane[0]) + abs(plane[1]) + abs(plane[2]))
    distance = -plane[3]
    for k in range(3):
        distance += plane[k] * (corner[k] + half)
    return bool(abs(distance) <= half_extent + (1 << (geometry.depth - geometry.finest_leaf_level)))


@compiled
def _with_reach(cube: tuple[Floats, float, float], reach_log2: int) -> tuple[Floats, float, float]:
    """The cube whose side is 2^reach_log2 times as long, with the step of such a cube."""
    return cube[0], cube[1] * 2.0**reach_log2, cube[2] * 2.0 ** (-0.5 * reach_log2)


@compiled
def _decide_plane(
    geometry: OctreeGeometry,
    moments: tuple[Floats, Floats],
    leaves: Leaves,
    candidates: Ints,
    cube: tuple[Floats, float, float],
    max_reach: int,
    indices: Ints,
) -> tuple[int, int]:
    """Merge index of least cost, and the reach of a new plane.

    moments: of the leaf and of its region, to which a new plane is fitted. For a new plane the
    merge index is len(candidates), and `indices` are written.
    """
    plane = np.empty(4)
    reach_log2, bits = _quantise_region_plane(
        geometry, moments[1], leaves, candidates, cube, max_reach, indices, plane
    )
    best, least = len(candidates), squared_distance(moments[0], plane) + geometry.lmbda * bits
    for k in range(len(candidates)):
        cost = squared_distance(moments[0], leaves.planes[candidates[k]]) + geometry.lmbda * (1 + k)
        if cost < least:
            best, least = k, cost
    return best, reach_log2


@compiled
def _quantise_region_plane(
    geometry: OctreeGeometry,
    region: Floats,
    leaves: Leaves,
    candidates: Ints,
    cube: tuple[Floats, float, float],
    max_reach: int,
    indices: Ints,
    plane: Floats,
) -> tuple[int, float]:
    """Write a region's plane with the reach of least cost; that reach and the estimated bits."""
    fitted, dequantised = np.empty(4), np.empty(4)
    fit_plane(region, fitted)
    trial, predicted = np.zeros(4, np.int64), np.zeros(4, np.int64)
    least, best, bits_of_best = np.inf, 0, 0.0
    for reach_log2 in range(max_reach + 1):
        finer = _with_reach(cube, reach_log2)
        quantise_plane(fitted, finer, trial)
        if len(candidates) > 0:
            quantise_plane(leaves.planes[candidates[0]], finer, predicted)
        dequantise_plane(trial, finer, dequantised)
        bits = reach_log2 + (3.0 if trial[0] == predicted[0] else 6.0)
        for k in range(1, 4):
            bits += 1.0 + 2.0 * np.log2(1.0 + abs(trial[k] - predicted[k]))
        cost = squared_distance(region, dequantised) + geometry.lmbda * bits
        if cost < least:
            least, best, bits_of_best = cost, reach_log2, bits
            indices[:] = trial
            plane[:] = dequantised
    return best, bits_of_best


@compiled_in_place
def _code_merge_index(
    coder: Coder, base: tuple[int, int], merge_index: int, count: int, down: int
) -> int:
    """Code which candidate's plane a leaf shares; `count` for none."""
    at, mixer = base[0] + _MERGE, base[1] + _MERGE_MIXER
    for k in range(count):
        contexts = (at + 16 * k + min(down, 15), at + 64 + 8 * k + count, at + 128 + k)
        if code_bit(coder, 1 if merge_index == k else 0, mixer + k, contexts) == 1:
            return k
    return count


@compiled_in_place
def _code_reach(
    coder: Coder, base: tuple[int, int], reach_log2: int, down: int, max_reach: int
) -> int:
    """Code the reach of a new plane, as the logarithm of a multiple of the leaf's side."""
    at, mixer = base[0] + _REACH, base[1] + _REACH_MIXER
    for size in range(max_reach):
        by_size = at + 8 * min(down, 15) + size
        contexts = (by_size, by_size, at + 128 + size)
        if code_bit(coder, 1 if reach_log2 > size else 0, mixer, contexts) == 0:
            return size
    return max_reach


@compiled_in_place
def _code_parameters(
    coder: Coder,
    base: tuple[int, int],
    indices: Ints,
    predicted: Ints,
    has_prediction: bool,
    down: int,
) -> None:
    """Code axis, height and slopes of a plane; `indices` becomes what was read."""
    known = 1 if has_prediction else 0
    indices[0] = _code_axis(coder, base, indices[0], predicted[0], known)
    fit = 1 if known and indices[0] == predicted[0] else 0
    at = base[0] + _PARAMETERS
    for k in range(3):
        guess = predicted[k + 1] if fit else 0
        by_size = at + 40 * (3 * min(down, 15) + k)
        by_kind = at + 40 * (48 + 3 * fit + k)
        mixer = base[1] + _PARAMETER_MIXER + 3 * (k > 0) + 6 * fit
        number = code_number(coder, indices[k + 1] - guess, mixer, by_size, by_kind)
        indices[k + 1] = guess + number


@compiled_in_place
def _code_axis(coder: Coder, base: tuple[int, int], axis: int, expected: int, known: int) -> int:
    """Code the dominant axis, given the expected one."""
    at, mixer = base[0] + _AXIS + 6 * known, base[1] + _AXIS_MIXER
    if code_bit(coder, 1 if axis == expected else 0, mixer, (at, at + 1, at + 1)) == 1:
        return expected
    following = (expected + 1) % 3
    bit = code_bit(coder, 1 if axis == following else 0, mixer + 1, (at + 2, at + 3, at + 3))
    return following if bit == 1 else (expected + 2) % 3


@compiled_in_place
def quantise_plane(plane: Floats, cube: tuple[Floats, float, float], indices: Ints) -> None:
    """Write the quantisation indices of a plane: axis, height at a cube's centre, two slopes.

    Parameters
    ----------
    plane
        (4,) unit normal and offset.
    cube
        Centre (3,), half the side, and quantisation step, in cells.
    indices
        (4,) written; slopes are in steps across half the cube.
    """
    centre, half, step = cube
    axis = dominant_axis(plane)
    off = plane[3] - plane[0] * centre[0] - plane[1] * centre[1] - plane[2] * centre[2]
    indices[0] = axis
    indices[1] = int(np.rint(off / plane[axis] / step))
    for k in range(1, 3):
        slope = -plane[(axis + k) % 3] / plane[axis]
        indices[1 + k] = int(np.rint(slope * half / step))


@compiled
def dequantise_plane(indices: Ints, cube: tuple[Floats, float, float], plane: Floats) -> None:
    """Write the plane (4,) of the indices that `quantise_plane` makes."""
    centre, half, step = cube
    axis = indices[0]
    a, b = -indices[2] * step / half, -indices[3] * step / half
    length = np.sqrt(1 + a * a + b * b)
    plane[axis], plane[(axis + 1) % 3], plane[(axis + 2) % 3] = 1 / length, a / length, b / length
    off = plane[axis] * indices[1] * step
    plane[3] = off + plane[0] * centre[0] + plane[1] * centre[1] + plane[2] * centre[2]

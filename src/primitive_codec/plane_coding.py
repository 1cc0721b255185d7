"""Coding of the plane of a leaf.

A leaf either shares the plane of a neighbouring leaf, or has a new plane. A shared plane is
signalled by an index, as in the merge mode of video codecs. A new plane is predicted from
neighbouring planes; the encoder fits it to the whole region of the leaf (see `region_merging`).
Planes of larger regions are quantised more finely.
"""

from __future__ import annotations

import numpy as np

from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats
from pointkit.geometry.moments import fit_plane, squared_distance
from primitive_codec.entropy import ContextCoder, code_bit, code_number, is_writing
from primitive_codec.octree_arrays import (
    EncoderNodes,
    Ints,
    OctreeGeometry,
    PlaneOctree,
    dominant_axis,
    leaf_at,
)

Cube = tuple[Floats, float, float]
"""Centre (3,), half the side, and quantisation step of planes, in cells."""
_MAX_CANDIDATES = 4
_MAX_EXTENT_LOG2 = 4
"""Largest log2 of (region extent / leaf side)."""
_MAX_CONTACTS = 64

# Index of the first context and of the first mixer of each kind of bit.
_MERGE = 0
_AXIS = _MERGE + 192
_PARAMETERS = _AXIS + 12
_EXTENT = _PARAMETERS + 40 * 3 * 18
CONTEXTS = _EXTENT + 17 * 8
_MERGE_MIXER, _AXIS_MIXER, _PARAMETER_MIXER, _EXTENT_MIXER = 0, 4, 6, 18
MIXERS = 19


@compiled
def code_plane(
    coder: ContextCoder, octree: PlaneOctree, level: int, node: Ints, nodes: EncoderNodes
) -> None:
    """Encode or decode the plane of a leaf, and append the leaf to `octree.leaves`.

    The encoder chooses the plane with the least squared distance + lmbda * estimated bits.

    Parameters
    ----------
    coder
        Arithmetic coder; its direction decides between encoding and decoding.
    octree
        The octree with the leaves that are already coded.
    level
        Level of the leaf.
    node
        Coordinates of the leaf at this level, and its index in `nodes`, together (4,).
    nodes
        The encoder's nodes; a decoder does not read them.
    """
    geometry, leaves = octree.geometry, octree.leaves
    side_log2 = geometry.depth - level
    side = 1 << side_log2
    corner = node[:3] << side_log2
    candidates = np.zeros(_MAX_CANDIDATES, np.int64)
    candidate_count = _merge_candidates(octree, corner, side, candidates)
    cube = (corner.astype(np.float64) + side / 2, side / 2, geometry.plane_steps[level])
    predicted, indices = np.zeros(4, np.int64), np.zeros(4, np.int64)
    merge_index, extent_log2, max_extent_log2 = (
        candidate_count,
        0,
        max(min(_MAX_EXTENT_LOG2, 15 - side_log2), 0),
    )
    if is_writing(coder):
        moments = (nodes.moments[node[3]], nodes.region_moments[node[3]])
        merge_index, extent_log2 = _decide_plane(
            octree, moments, candidates[:candidate_count], cube, max_extent_log2, indices
        )
    merge_index = _code_merge_index(coder, merge_index, candidate_count, side_log2)
    if merge_index < candidate_count:
        plane = candidates[merge_index]
    else:
        extent_log2 = _code_extent(coder, extent_log2, side_log2, max_extent_log2)
        cube = _extended(cube, extent_log2)
        if candidate_count > 0:
            quantise_plane(leaves.planes[candidates[0]], cube, predicted)
        _code_parameters(coder, indices, predicted, candidate_count > 0, side_log2 + extent_log2)
        plane = leaves.counts[1]
        leaves.counts[1] += 1
        dequantise_plane(indices, cube, leaves.planes[plane])
    _add_leaf(octree, corner, side, plane)


@compiled_in_place
def _add_leaf(octree: PlaneOctree, corner: Ints, side: int, plane: int) -> None:
    geometry, leaves = octree.geometry, octree.leaves
    leaf = leaves.counts[0]
    leaves.counts[0] += 1
    for k in range(3):
        leaves.corner[leaf, k] = corner[k]
    leaves.side[leaf] = side
    leaves.plane_index[leaf] = plane
    side_log2 = geometry.depth - geometry.finest_leaf_level
    x, y, z, size = (
        corner[0] >> side_log2,
        corner[1] >> side_log2,
        corner[2] >> side_log2,
        side >> side_log2,
    )
    octree.leaf_grid[x : x + size, y : y + size, z : z + size] = leaf + 1


@compiled
def _merge_candidates(octree: PlaneOctree, corner: Ints, side: int, candidates: Ints) -> int:
    """Write planes of leaves adjacent to a cube, longest contact first, and return their number."""
    contacts, planes = np.zeros(_MAX_CONTACTS, np.int64), np.zeros(_MAX_CONTACTS, np.int64)
    count = _count_contacts(octree, corner, side, contacts, planes)
    kept = 0
    while kept < len(candidates):
        best = np.argmax(contacts[:count]) if count else 0
        if contacts[best] == 0:
            break
        contacts[best] = 0
        if _is_near(octree.geometry, octree.leaves.planes[planes[best]], corner, side):
            candidates[kept] = planes[best]
            kept += 1
    return kept


@compiled_in_place
def _count_contacts(
    octree: PlaneOctree, corner: Ints, side: int, contacts: Ints, planes: Ints
) -> int:
    count, shape, plane_index = 0, octree.geometry.shape, octree.leaves.plane_index
    for x in range(max(corner[0] - 1, 0), min(corner[0] + side + 1, shape[0])):
        for y in range(max(corner[1] - 1, 0), min(corner[1] + side + 1, shape[1])):
            inside = corner[0] <= x < corner[0] + side and corner[1] <= y < corner[1] + side
            for z in range(max(corner[2] - 1, 0), min(corner[2] + side + 1, shape[2])):
                if inside and corner[2] <= z < corner[2] + side:
                    continue
                leaf = leaf_at(octree, x, y, z) - 1
                if leaf >= 0:
                    count = _add_contact(plane_index[leaf], count, contacts, planes)
    return count


@compiled_in_place
def _add_contact(plane: int, count: int, contacts: Ints, planes: Ints) -> int:
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
    half = side / 2
    half_extent = half * (abs(plane[0]) + abs(plane[1]) + abs(plane[2]))
    distance = -plane[3]
    for k in range(3):
        distance += plane[k] * (corner[k] + half)
    return bool(abs(distance) <= half_extent + (1 << (geometry.depth - geometry.finest_leaf_level)))


@compiled
def _extended(cube: Cube, extent_log2: int) -> Cube:
    return cube[0], cube[1] * 2.0**extent_log2, cube[2] * 2.0 ** (-0.5 * extent_log2)


@compiled
def _decide_plane(
    octree: PlaneOctree, moments: tuple[Floats, Floats], candidates: Ints, cube: Cube,
    max_extent_log2: int, indices: Ints,
) -> tuple[int, int]:  # fmt: skip
    plane, planes, lmbda = np.empty(4), octree.leaves.planes, octree.geometry.lmbda
    extent_log2, bits = _quantise_region_plane(
        octree, moments[1], candidates, cube, max_extent_log2, indices, plane
    )
    least = squared_distance(moments[0], plane) + lmbda * bits
    merge_index = len(candidates)
    for k in range(len(candidates)):
        cost = squared_distance(moments[0], planes[candidates[k]]) + lmbda * (1 + k)
        if cost < least:
            merge_index, least = k, cost
    return merge_index, extent_log2


@compiled
def _quantise_region_plane(
    octree: PlaneOctree, region: Floats, candidates: Ints, cube: Cube, max_extent_log2: int,
    indices: Ints, plane: Floats,
) -> tuple[int, float]:  # fmt: skip
    fitted, dequantised = np.empty(4), np.empty(4)
    fit_plane(region, fitted)
    trial_indices, predicted = np.zeros(4, np.int64), np.zeros(4, np.int64)
    least, best_extent_log2, best_bits = np.inf, 0, 0.0
    for extent_log2 in range(max_extent_log2 + 1):
        extended = _extended(cube, extent_log2)
        quantise_plane(fitted, extended, trial_indices)
        if len(candidates) > 0:
            quantise_plane(octree.leaves.planes[candidates[0]], extended, predicted)
        dequantise_plane(trial_indices, extended, dequantised)
        bits = extent_log2 + (3.0 if trial_indices[0] == predicted[0] else 6.0)
        for k in range(1, 4):
            bits += 1.0 + 2.0 * np.log2(1.0 + abs(trial_indices[k] - predicted[k]))
        cost = squared_distance(region, dequantised) + octree.geometry.lmbda * bits
        if cost < least:
            least, best_extent_log2, best_bits = cost, extent_log2, bits
            indices[:] = trial_indices
            plane[:] = dequantised
    return best_extent_log2, best_bits


@compiled_in_place
def _code_merge_index(
    coder: ContextCoder, merge_index: int, candidate_count: int, side_log2: int
) -> int:
    for k in range(candidate_count):
        size_context = _MERGE + 16 * k + min(side_log2, 15)
        contexts = (size_context, _MERGE + 64 + 8 * k + candidate_count, _MERGE + 128 + k)
        if code_bit(coder, 1 if merge_index == k else 0, _MERGE_MIXER + k, contexts) == 1:
            return k
    return candidate_count


@compiled_in_place
def _code_extent(
    coder: ContextCoder, extent_log2: int, side_log2: int, max_extent_log2: int
) -> int:
    for k in range(max_extent_log2):
        size_context = _EXTENT + 8 * min(side_log2, 15) + k
        contexts = (size_context, size_context, _EXTENT + 128 + k)
        if code_bit(coder, 1 if extent_log2 > k else 0, _EXTENT_MIXER, contexts) == 0:
            return k
    return max_extent_log2


@compiled_in_place
def _code_parameters(
    coder: ContextCoder, indices: Ints, predicted: Ints, has_prediction: bool, side_log2: int
) -> None:
    indices[0] = _code_axis(coder, indices[0], predicted[0], 1 if has_prediction else 0)
    is_same_axis = 1 if has_prediction and indices[0] == predicted[0] else 0
    for k in range(3):
        prediction = predicted[k + 1] if is_same_axis else 0
        size_context = _PARAMETERS + 40 * (3 * min(side_log2, 15) + k)
        kind_context = _PARAMETERS + 40 * (48 + 3 * is_same_axis + k)
        mixer = _PARAMETER_MIXER + 3 * (k > 0) + 6 * is_same_axis
        number = code_number(coder, indices[k + 1] - prediction, mixer, size_context, kind_context)
        indices[k + 1] = prediction + number


@compiled_in_place
def _code_axis(coder: ContextCoder, axis: int, expected: int, has_prediction: int) -> int:
    start = _AXIS + 6 * has_prediction
    contexts = (start, start + 1, start + 1)
    if code_bit(coder, 1 if axis == expected else 0, _AXIS_MIXER, contexts) == 1:
        return expected
    next_axis = (expected + 1) % 3
    contexts = (start + 2, start + 3, start + 3)
    bit = code_bit(coder, 1 if axis == next_axis else 0, _AXIS_MIXER + 1, contexts)
    return next_axis if bit == 1 else (expected + 2) % 3


@compiled_in_place
def quantise_plane(plane: Floats, cube: Cube, indices: Ints) -> None:
    """Write the quantisation indices (4,) of a plane to `indices`.

    They are the dominant axis, the height at the cube's centre, and two slopes.
    """
    centre, half, step = cube
    axis = dominant_axis(plane)
    offset = plane[3] - plane[0] * centre[0] - plane[1] * centre[1] - plane[2] * centre[2]
    indices[0] = axis
    indices[1] = int(np.rint(offset / plane[axis] / step))
    for k in range(1, 3):
        slope = -plane[(axis + k) % 3] / plane[axis]
        indices[1 + k] = int(np.rint(slope * half / step))


@compiled
def dequantise_plane(indices: Ints, cube: Cube, plane: Floats) -> None:
    """Write the plane (4,), unit normal and offset, that quantisation indices (4,) describe."""
    centre, half, step = cube
    axis = indices[0]
    a, b = -indices[2] * step / half, -indices[3] * step / half
    length = np.sqrt(1 + a * a + b * b)
    plane[axis], plane[(axis + 1) % 3], plane[(axis + 2) % 3] = 1 / length, a / length, b / length
    offset = plane[axis] * indices[1] * step
    plane[3] = offset + plane[0] * centre[0] + plane[1] * centre[1] + plane[2] * centre[2]

"""Coding of the levels of an octree: each node's planar modes, and its occupancy or IDCM points.

Nodes are coded breadth-first, as in TMC13's `GeometryOctreeEncoder` and `GeometryOctreeDecoder`.
Functions encode if they get a `Source`, and decode otherwise.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.angular import NO_LASER, Angular, PlaneAngles, angular_eligible_axes, plane_angles
from gpcc.arithmetic import Bytes, code_bit, code_count, exhausted
from gpcc.compiled import entry, integer, kernel, part
from gpcc.contexts import CTX_BLOCK_SKIP_TH, CTX_DUP_POINT_CNT_EGL, CTX_DUP_POINT_CNT_GT0
from gpcc.idcm import (
    IdcmNode,
    LocalPoints,
    can_be_direct,
    code_direct_positions,
    is_idcm_eligible,
    leaf_code,
    local_points,
    order_pair,
)
from gpcc.neighbours import (
    OccupancyAtlas,
    face_neighbours,
    neigh_pattern_of,
    neighbour_grid,
    predict_occupancy,
    refine_by_adjacent_children,
    update_atlas,
)
from gpcc.occupancy import OccupancyNeighbourhood, PlanarMasks, code_occupancy, no_child_masked
from gpcc.planar import (
    PlanarNode,
    PlanarState,
    code_planar_modes,
    planar_eligible_axes,
    planar_mask,
    update_planar_rates,
)
from pointkit.coding.intrinsics import bit_count
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints, first_child_code

EXHAUSTED = -1
TOO_MANY_POINTS = -2


class Level(NamedTuple):
    """Properties that all nodes of a level of the octree share."""

    # coded_axes, coded_axes_prev_level: axes (4 x, 2 y, 1 z) split by this and the previous level.
    coded_axes: int
    coded_axes_prev_level: int
    node_size_log2: tuple[int, int, int]
    root: bool
    # Whether the children are leaves.
    last: bool
    adjacent_child_ctx: bool
    intra_pred: bool
    unique_points: bool
    idcm_mode: int
    joint_2pt_idcm: bool
    # See `idcm.idcm_enable_mask`.
    idcm_enable_mask: int


class Nodes(NamedTuple):
    """Those nodes (n,) of a level that have children."""

    morton: Ints
    occupancy: Bytes
    # Mask of the children that may use IDCM.
    idcm_eligible: Bytes
    # In an encoder, index of the first child within its level.
    first_child: NDArray[np.int32]
    # Index of the laser that sees the node, or NO_LASER.
    laser: Bytes


class Source(NamedTuple):
    """A level of the octree that an encoder codes; see also `tree.TreeLevel` and `tree.Tree`."""

    occupancy: Bytes
    first_child: NDArray[np.int32]
    # Index of each node's first leaf, then the number of leaves.
    first_leaf: NDArray[np.int32]
    # Morton code of each leaf.
    leaves: Ints
    counts: NDArray[np.int32]
    second_first: Bytes


class SliceState(NamedTuple):
    """State that lasts from level to level while a slice is coded."""

    atlas: OccupancyAtlas
    planar: PlanarState
    # Morton codes of the coded points; may be empty in an encoder.
    leaves: Ints
    # Number of coded points; of allowed points; of nodes with children in this level; of these
    # children; idcm_enable_mask.
    counters: Ints
    local: LocalPoints
    # A byte for each neighbourhood; the upper five bits select the context of an occupancy bit.
    ctx_idx_maps: Bytes


class ParentNode(NamedTuple):
    """A node whose children are being coded."""

    first_child_code: int
    sibling_occupancy: int
    # faces, grid: results of `neighbours.face_neighbours` and `neighbours.neighbour_grid`.
    faces: int
    grid: int
    idcm_eligible: int
    first_child: int
    laser: int


@entry
def code_level(
    coder: Any,
    level: Level,
    parents: Nodes,
    nodes: Nodes,
    source: Source | None,
    state: SliceState,
    angular: Angular | None,
) -> int:
    """Encode the children of a level's nodes if there is a `source`, and decode them otherwise.

    Parameters
    ----------
    coder
        The arithmetic encoder or decoder.
    level
        Properties of the children.
    parents
        Nodes of the level above.
    nodes
        Result: those children that have children themselves.
    source
        The level that an encoder codes; None in a decoder.
    state
        State of the slice.
    angular
        State of the sensor in angular mode; None without a sensor.

    Returns
    -------
    int
        Number of nodes in the result, or EXHAUSTED or TOO_MANY_POINTS if a stream is damaged.
    """
    atlas, axes, count = state.atlas, level.coded_axes_prev_level, len(parents.morton)
    state.counters[2:4] = 0
    state.counters[4] = level.idcm_enable_mask
    cube_start, cube_end = 0, 0
    for p in range(count):
        if atlas.side and p == cube_end:
            cube_end = update_atlas(atlas, parents.morton, parents.occupancy, axes, cube_start, p)
            cube_start = p
        sibling_occupancy = integer(parents.occupancy[p])
        if state.planar.enabled and not level.root:
            update_planar_rates(state.planar, sibling_occupancy)
        base = first_child_code(parents.morton[p], axes)
        faces = face_neighbours(atlas, axes, base, sibling_occupancy)
        grid = neighbour_grid(atlas, axes, base) if level.intra_pred else 0
        first = integer(parents.first_child[p]) if source is not None else 0
        laser = integer(parents.laser[p]) if angular is not None else NO_LASER
        parent = ParentNode(
            base, sibling_occupancy, faces, grid, integer(parents.idcm_eligible[p]), first, laser
        )
        fault = _code_children(coder, level, parent, nodes, source, state, angular)
        if fault:
            return fault
    if atlas.side:
        update_atlas(atlas, parents.morton, parents.occupancy, axes, cube_start, count)
    return integer(state.counters[2])


@part
def _code_children(
    coder: Any,
    level: Level,
    parent: ParentNode,
    nodes: Nodes,
    source: Source | None,
    state: SliceState,
    angular: Angular | None,
) -> int:
    index, counters = parent.first_child, state.counters
    for child in range(8):
        if parent.sibling_occupancy >> child & 1 == 0:
            continue
        occupancy, neigh_pattern, laser = _code_node(
            coder, level, source, state, angular, parent, child, index
        )
        if occupancy and level.last:
            _code_leaf_point_counts(
                coder, level, source, state, parent.first_child_code | child, occupancy, index
            )
        elif occupancy:
            kept = counters[2]
            nodes.morton[kept] = parent.first_child_code | child
            nodes.occupancy[kept] = occupancy
            nodes.idcm_eligible[kept] = _idcm_eligible_children(
                level, parent.sibling_occupancy, neigh_pattern, occupancy, counters
            )
            if source is not None:
                nodes.first_child[kept] = source.first_child[index]
            if angular is not None:
                nodes.laser[kept] = laser
            counters[2] += 1
            counters[3] += bit_count(occupancy)
        index += 1
        if _is_damaged(coder, angular):
            return EXHAUSTED
        if counters[0] + counters[3] > counters[1]:
            return TOO_MANY_POINTS
    return 0


@inlined
def _is_damaged(coder: Any, angular: Angular | None) -> bool:
    if angular is not None:
        return exhausted(coder) or angular.fault[0] != 0
    return exhausted(coder)


@part
def _code_node(
    coder: Any,
    level: Level,
    source: Source | None,
    state: SliceState,
    angular: Angular | None,
    parent: ParentNode,
    child: int,
    index: int,
) -> tuple[int, int, int]:
    """Encode or decode a node; return its occupancy (0 with IDCM), neighbour pattern and laser."""
    morton = parent.first_child_code | child
    neigh_pattern = neigh_pattern_of(parent.faces, child)
    gt0, gt1, unocc, adjacent_occupancies = 0, 0, 0, 0
    if level.adjacent_child_ctx:
        neigh_pattern, gt0, gt1, unocc, adjacent_occupancies = refine_by_adjacent_children(
            state.atlas, level.coded_axes, morton, neigh_pattern
        )
    occupancy = integer(source.occupancy[index]) if source is not None else 0
    angles = PlaneAngles(-1, -1, -1, NO_LASER)
    if angular is not None:
        angles = plane_angles(angular, morton, level.node_size_log2, parent.laser)
    planar_mode, plane_pos_bits, planar_possible = 0, 0, 7
    if state.planar.enabled:
        sibling_occupancy = 0 if level.root else parent.sibling_occupancy
        node = PlanarNode(
            morton,
            child,
            sibling_occupancy,
            neigh_pattern,
            adjacent_occupancies,
            level.adjacent_child_ctx,
            (angles.x, angles.y, angles.z),
        )
        eligible_axes = planar_eligible_axes(state.planar, level.coded_axes)
        if angular is not None:
            eligible_axes = angular_eligible_axes(angles, eligible_axes, level.coded_axes)
        planar_mode, plane_pos_bits, planar_possible = code_planar_modes(
            coder, state.planar, node, eligible_axes, occupancy
        )
    if parent.idcm_eligible >> child & 1 and _code_direct_positions(
        coder, level, source, state, angular, morton, index, planar_mode, plane_pos_bits
    ):
        occupancy = 0
    else:
        masks = _planar_masks(level.coded_axes, planar_mode, plane_pos_bits, planar_possible)
        is_predicted, prediction = 0, 0
        if level.intra_pred and no_child_masked(masks):
            is_predicted, prediction = predict_occupancy(parent.grid, child)
        neighbours_known = integer(state.atlas.side > 0)
        neighbourhood = OccupancyNeighbourhood(
            neighbours_known, neigh_pattern, gt0, gt1, unocc, is_predicted, prediction
        )
        occupancy = code_occupancy(coder, state.ctx_idx_maps, neighbourhood, masks, occupancy)
    if level.adjacent_child_ctx:
        state.atlas.nodes[morton & ((1 << 3 * state.atlas.side) - 1)] = occupancy
    return occupancy, neigh_pattern, angles.laser


@inlined
def _planar_masks(
    axes: int, planar_mode: int, plane_pos_bits: int, planar_possible: int
) -> PlanarMasks:
    # Along an axis that is not split, all children are in the lower plane.
    planar_mode |= ((axes >> 2 & 1) | (axes & 2) | (axes & 1) << 2) ^ 7
    return PlanarMasks(
        planar_mask(planar_mode, plane_pos_bits, 0),
        planar_mask(planar_mode, plane_pos_bits, 1),
        planar_mask(planar_mode, plane_pos_bits, 2),
        planar_possible,
    )


@inlined
def _idcm_eligible_children(
    level: Level, sibling_occupancy: int, neigh_pattern: int, occupancy: int, counters: Ints
) -> int:
    if level.idcm_mode == 0:
        return 0
    parent = 8 if level.root else bit_count(sibling_occupancy)
    size = max(level.node_size_log2[0], level.node_size_log2[1], level.node_size_log2[2])
    if not is_idcm_eligible(level.idcm_mode, size, neigh_pattern, parent, bit_count(occupancy)):
        return 0
    mask, enabled = 0, counters[4]
    for child in range(8):
        if occupancy >> child & 1:
            mask |= (enabled & 1) << child
            enabled = enabled >> 1 | (enabled & 1) << 31
    counters[4] = enabled
    return mask


@inlined
def _code_direct_positions(
    coder: Any,
    level: Level,
    source: Source | None,
    state: SliceState,
    angular: Angular | None,
    morton: int,
    index: int,
    planar_mode: int,
    plane_pos_bits: int,
) -> bool:
    leaves, points, start, end = 0, 0, 0, 0
    if source is not None:
        start, end = integer(source.first_leaf[index]), integer(source.first_leaf[index + 1])
        leaves = end - start
        points = leaves if level.unique_points else _points(source, start, end)
    is_direct = integer(can_be_direct(level.unique_points, leaves, points))
    if not code_bit(coder, CTX_BLOCK_SKIP_TH, is_direct):
        return False
    node = IdcmNode(
        morton,
        level.node_size_log2,
        level.unique_points,
        level.joint_2pt_idcm,
        planar_mode,
        plane_pos_bits,
    )
    if source is not None:
        local_points(source.leaves[start:end], level.node_size_log2, state.local.points_in)
        if leaves == 2:
            second_first = angular is not None and source.second_first[start] != 0
            order_pair(node, angular, level.coded_axes, second_first, state.local.points_in)
    leaves, points = code_direct_positions(coder, node, angular, state.local, leaves, points)
    for i in range(leaves):
        point_count = points - leaves + 1 if i == 0 else 1
        _append_points(
            state, leaf_code(morton, level.node_size_log2, state.local.coded[i]), point_count
        )
    return True


@kernel
def _points(source: Source, start: int, end: int) -> int:
    points = 0
    for leaf in range(start, end):
        points += source.counts[leaf]
    return points


@kernel
def _code_leaf_point_counts(
    coder: Any,
    level: Level,
    source: Source | None,
    state: SliceState,
    morton: int,
    occupancy: int,
    index: int,
) -> None:
    base = first_child_code(morton, level.coded_axes)
    leaf = integer(source.first_child[index]) if source is not None else 0
    for child in range(8):
        if occupancy >> child & 1 == 0:
            continue
        points = integer(1)
        if not level.unique_points:
            dup_point_cnt = integer(source.counts[leaf]) - 1 if source is not None else 0
            points += code_count(coder, CTX_DUP_POINT_CNT_GT0, CTX_DUP_POINT_CNT_EGL, dup_point_cnt)
        _append_points(state, base | child, points)
        leaf += 1


@inlined
def _append_points(state: SliceState, morton: int, points: int) -> None:
    done = state.counters[0]
    for i in range(done, min(done + points, len(state.leaves))):
        state.leaves[i] = morton
    state.counters[0] = done + points

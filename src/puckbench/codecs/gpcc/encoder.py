"""Encoding of one slice: points to a geometry data unit."""

from __future__ import annotations

import numpy as np

from puckbench.codecs.gpcc import direct, models, neighbours, octree, planar
from puckbench.codecs.gpcc.arithmetic import encoder, enlarged, finish
from puckbench.codecs.gpcc.syntax import (
    GeometryFooter,
    GeometryHeader,
    GeometryParameterSet,
    SequenceParameterSet,
    footer_bytes,
    geometry_header,
    written,
)
from puckbench.codecs.gpcc.tree import Tree, leaf_codes, leaf_starts, node_bits
from puckbench.geometry.morton import Ints

# Most bytes that one node can take: eight bits of at most a byte each and planes; the coordinates
# and counts of direct points; the counts of eight leaves.
_NODE_BYTES, _DIRECT_BYTES, _LEAVES_BYTES = 16, 128, 256


def encode_slice(
    tree: Tree,
    header: GeometryHeader,
    sps: SequenceParameterSet,
    gps: GeometryParameterSet,
) -> bytes:
    """A geometry data unit with the points of `tree`, split as the header says."""
    points = len(tree.keys) if gps.geom_unique_points_flag else int(tree.counts.sum())
    footer = GeometryFooter(geom_num_points_minus1=points - 1)
    head = written(geometry_header, header, sps, gps)
    return head + coded_tree(tree, header, gps) + footer_bytes(footer)


def coded_tree(tree: Tree, header: GeometryHeader, gps: GeometryParameterSet) -> bytes:
    """The arithmetic-coded part of a data unit."""
    coder = encoder(64)
    adaptive = models.fresh_models()
    state = slice_state(gps, len(tree.levels), 0)
    parents = root_parent()
    levels = zip(levels_of(header, gps), _sources(tree, header, gps), strict=True)
    for number, (level, source) in enumerate(levels):
        planar.forget_planes(state.planar, 1 << number)
        count = len(source.occupancy)
        coder = enlarged(coder, 64 + count * _most_bytes(level))
        nodes = empty_nodes(0 if level.last else count, encoding=True)
        kept = octree.code_level(coder, adaptive, level, parents, nodes, source, state)
        parents = first_nodes(nodes, kept)
        if not kept:
            break
    return finish(coder)


def _most_bytes(level: octree.Level) -> int:
    counts = 0 if level.unique or not level.last else _LEAVES_BYTES
    return _NODE_BYTES + (_DIRECT_BYTES if level.direct else 0) + counts


def _sources(tree: Tree, header: GeometryHeader, gps: GeometryParameterSet) -> list[octree.Source]:
    """What each level is coded from."""
    nothing = np.empty(0, dtype=np.int32)
    starts = [nothing] * len(tree.levels)
    leaves: Ints = np.empty(0, dtype=np.int64)
    if gps.inferred_direct_coding_mode:
        starts = leaf_starts(tree)
        leaves = leaf_codes(tree, header.tree_lvl_coded_axis_list)
    return [
        octree.Source(level.occupancy, level.first, start, leaves, tree.counts)
        for level, start in zip(tree.levels, starts, strict=True)
    ]


def levels_of(header: GeometryHeader, gps: GeometryParameterSet) -> list[octree.Level]:
    """What is the same for all nodes of each level of a slice's tree."""
    axes = header.tree_lvl_coded_axis_list
    enabled = direct.enabled_mask(
        gps.inferred_direct_coding_mode,
        bool(gps.geom_planar_mode_enabled_flag),
        gps.geom_idcm_rate_minus1,
    )
    return [
        _level(gps, number, bits, (above, split), enabled, last=number == len(axes) - 1)
        for number, (bits, above, split) in enumerate(
            zip(node_bits(axes)[:-1], [7, *axes[:-1]], axes, strict=True)
        )
    ]


def _level(
    gps: GeometryParameterSet,
    number: int,
    bits: tuple[int, int, int],
    axes: tuple[int, int],
    enabled: int,
    *,
    last: bool,
) -> octree.Level:
    boundary = gps.neighbour_avail_boundary_log2_minus1
    turn = number % 32
    return octree.Level(
        axes=axes[1],
        parent_axes=axes[0],
        bits=bits,
        root=number == 0,
        last=last,
        adjacent=bool(boundary and gps.adjacent_child_contextualization_enabled_flag),
        predict=boundary > 0 and max(bits) < gps.intra_pred_max_node_size_log2,
        unique=bool(gps.geom_unique_points_flag),
        direct=gps.inferred_direct_coding_mode,
        joint=bool(gps.joint_2pt_idcm_enabled_flag),
        enabled=(enabled >> turn | enabled << 32 - turn) & 0xFFFFFFFF,
    )


def slice_state(gps: GeometryParameterSet, depth: int, most_points: int) -> octree.Slice:
    """The state at the start of a slice, a tree of `depth` levels.

    most_points: how many decoded points there may be; 0 in an encoder.
    """
    minus1 = gps.neighbour_avail_boundary_log2_minus1
    thresholds = (
        gps.geom_planar_threshold0,
        gps.geom_planar_threshold1,
        gps.geom_planar_threshold2,
    )
    scratch = np.zeros((2, 3), dtype=np.int64)
    return octree.Slice(
        neighbours.atlas(min(minus1 + 1, depth) if minus1 else 0),
        planar.planar_state(bool(gps.geom_planar_mode_enabled_flag), depth, thresholds),
        np.empty(most_points, dtype=np.int64),
        np.array([0, most_points or 1 << 62, 0, 0, 0], dtype=np.int64),
        scratch,
        scratch.copy(),
        np.zeros(3, dtype=np.int64),
    )


def root_parent() -> octree.Nodes:
    """A parent whose only child, the first, is the root."""
    return octree.Nodes(
        np.zeros(1, dtype=np.int64),
        np.ones(1, dtype=np.uint8),
        np.zeros(1, dtype=np.uint8),
        np.zeros(1, dtype=np.int32),
    )


def empty_nodes(count: int, *, encoding: bool) -> octree.Nodes:
    """Room for `count` nodes."""
    return octree.Nodes(
        np.empty(count, dtype=np.int64),
        np.empty(count, dtype=np.uint8),
        np.empty(count, dtype=np.uint8),
        np.empty(count if encoding else 0, dtype=np.int32),
    )


def first_nodes(nodes: octree.Nodes, count: int) -> octree.Nodes:
    """The first `count` nodes."""
    return octree.Nodes(
        nodes.morton[:count], nodes.occupancy[:count], nodes.eligible[:count], nodes.first[:count]
    )

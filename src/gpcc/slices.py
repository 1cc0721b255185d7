"""Encoding and decoding of the slices of octree geometry, which are independent parts of a cloud.

The data unit of a slice consists of a header, the arithmetic-coded octree, and a footer with the
number of points (`GeometryBrickHeader`, `GeometryBrickFooter` in TMC13).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc import angular, idcm, neighbours, octree, planar
from gpcc.arithmetic import (
    Bytes,
    Decoder,
    Probabilities,
    consumed,
    decoder,
    encoder,
    enlarged,
    finish,
    restart,
)
from gpcc.bits import BitReader
from gpcc.contexts import Contexts, initial_contexts
from gpcc.syntax import (
    OCTREE,
    GeometryHeader,
    GeometryParameterSet,
    SequenceParameterSet,
    Three,
    footer_of,
    geometry_header,
    point_count,
    written,
)
from gpcc.tree import Tree, leaf_codes, leaf_starts, node_sizes_log2
from pointkit.errors import InputError
from pointkit.geometry.morton import MOST_BITS, Ints

_DAMAGED = "G-PCC stream: a slice's data are damaged or truncated"
_BYPASS_CHUNK = 256
_NODE_TYPES: Any = (np.int64, np.uint8, np.uint8, np.int32, np.uint8)

# Maximum number of bytes of a node: for occupancy and planes; for IDCM points, and in addition in
# angular mode; for the point counts of eight leaves.
_NODE_BYTES, _DIRECT_BYTES, _LASER_BYTES, _LEAVES_BYTES = 16, 128, 64, 256


@dataclass(frozen=True)
class CodedSlice:
    header: GeometryHeader
    data: bytes
    points: int


def data_unit(coded: CodedSlice, sps: SequenceParameterSet, gps: GeometryParameterSet) -> bytes:
    return written(geometry_header, coded.header, sps, gps) + coded.data + footer_of(coded.points)


def encode_octree(
    tree: Tree,
    header: GeometryHeader,
    gps: GeometryParameterSet,
    sensor: angular.Angular | None = None,
    leaves: Ints | None = None,
) -> bytes:
    """Encode the octree of a slice.

    Parameters
    ----------
    tree
        The octree.
    header, gps
        Header of the slice, and geometry parameter set.
    sensor
        State of the sensor in angular mode; None without a sensor.
    leaves
        Result: if an array (n,) is given, the Morton codes of the points are written to it in coded
        order.

    Returns
    -------
    bytes
        The arithmetic-coded bytes.
    """
    contexts = initial_contexts()
    coder = encoder(contexts.probabilities, 64)
    state = _initial_state(gps, len(tree.levels), 0, contexts)
    if leaves is not None:
        state = state._replace(leaves=leaves)
    parents = _root_parent()
    levels = zip(_levels(header, gps), _sources(tree, header, gps), strict=True)
    for number, (level, source) in enumerate(levels):
        planar.reset_planar_buffer(state.planar, 1 << number)
        count = len(source.occupancy)
        coder = enlarged(coder, 64 + count * _max_node_bytes(level, sensor))
        nodes = _empty_nodes(0 if level.last else count)
        kept = octree.code_level(coder, level, parents, nodes, source, state, sensor)
        parents = _first_nodes(nodes, kept)
        if not kept:
            break
    neighbours.return_atlas(state.atlas)
    return finish(coder)


def read_slice(payload: bytes, sps: SequenceParameterSet, gps: GeometryParameterSet) -> CodedSlice:
    """Return the header, the coded bytes and the number of points of a geometry data unit."""
    reader = BitReader(payload)
    header = GeometryHeader()
    geometry_header(reader, header, sps, gps)
    if gps.geom_tree_type == OCTREE:
        _check_axes(header.tree_lvl_coded_axis_list)
    body = payload[reader.position :]
    points, length = point_count(body, header, gps)
    return CodedSlice(header, body[: len(body) - length], points)


def _check_axes(axes: list[int]) -> None:
    if 0 in axes:
        raise InputError("G-PCC stream: a level of the tree splits no axis")
    if max(node_sizes_log2(axes)[0]) > MOST_BITS:
        raise InputError(f"G-PCC stream: positions of more than {MOST_BITS} bits")


def decode_slice(
    coded: CodedSlice,
    sps: SequenceParameterSet,
    gps: GeometryParameterSet,
    contexts: Contexts,
    sensor: angular.Angular | None = None,
) -> Ints:
    """Decode the octree of a slice.

    Parameters
    ----------
    coded
        Header, coded bytes and number of points.
    sps, gps
        Sequence parameter set and geometry parameter set.
    contexts
        Probabilities, which the decoding adapts.
    sensor
        State of the sensor in angular mode; None without a sensor.

    Returns
    -------
    ndarray
        Morton codes (n,) of the points, in coded order.

    Raises
    ------
    InputError
        The slice is damaged.
    """
    header = coded.header
    streams = header.geom_stream_cnt_minus1
    depth = len(header.tree_lvl_coded_axis_list)
    coder = slice_decoder(contexts.probabilities, coded, sps)
    state = _initial_state(gps, depth, coded.points, contexts)
    parents = _root_parent()
    lasting: list[NDArray[Any]] = [
        *contexts,
        state.planar.rates,
        *([sensor.azimuth] if sensor else []),
    ]
    saved: list[NDArray[Any]] = []
    for number, level in enumerate(_levels(header, gps)):
        if streams and number == max(depth - 1 - streams, 0):
            saved = [array.copy() for array in lasting]
        if streams and number > depth - 1 - streams:
            _next_stream(coder, lasting, saved)
        planar.reset_planar_buffer(state.planar, 1 << number)
        parents = _decode_level(coder, level, parents, state, sensor)
        if not len(parents.morton):
            break
    if state.counters[0] != coded.points:
        raise InputError("G-PCC stream: a slice holds fewer points than it says")
    neighbours.return_atlas(state.atlas)
    return state.leaves


def slice_decoder(contexts: Probabilities, coded: CodedSlice, sps: SequenceParameterSet) -> Decoder:
    data = np.frombuffer(coded.data, dtype=np.uint8)
    if not sps.bypass_stream_enabled_flag:
        return decoder(contexts, data)
    if coded.header.geom_stream_cnt_minus1:
        raise InputError("G-PCC stream: several entropy streams with bypass are not supported")
    return decoder(contexts, *demultiplexed(data))


def demultiplexed(data: Bytes) -> tuple[Bytes, Bytes]:
    """Split a stream of chunks into arithmetic-coded bytes and bypass bits.

    A chunk of up to 256 bytes holds the number of arithmetic-coded bytes, these bytes, and bytes of
    bypass bits in reverse order. Padding bits and their number (three bits) follow the bypass bits.

    Returns
    -------
    coded
        The arithmetic-coded bytes.
    bypass
        The bypass bits, each of them as one byte.
    """
    coded, bits = [np.empty(0, np.uint8)], [np.empty(0, np.uint8)]
    for start in range(0, len(data), _BYPASS_CHUNK):
        chunk = data[start : start + _BYPASS_CHUNK]
        split = 1 + int(chunk[0])
        coded.append(chunk[1:split])
        if split < len(chunk):
            unpacked = np.unpackbits(chunk[split:][::-1])
            padding = int(chunk[split]) & 7
            bits.append(unpacked[: max(len(unpacked) - 3 - padding, 0)])
    return np.concatenate(coded), np.concatenate(bits)


def _next_stream(coder: Decoder, lasting: list[NDArray[Any]], saved: list[NDArray[Any]]) -> None:
    restart(coder)
    for array, before in zip(lasting, saved, strict=True):
        np.copyto(array, before)


def _decode_level(
    coder: Decoder,
    level: octree.Level,
    parents: octree.Nodes,
    state: octree.SliceState,
    sensor: angular.Angular | None,
) -> octree.Nodes:
    count = int(np.bitwise_count(parents.occupancy).sum())
    nodes = _empty_nodes(0 if level.last else count)
    kept = octree.code_level(coder, level, parents, nodes, None, state, sensor)
    if kept == octree.TOO_MANY_POINTS:
        raise InputError("G-PCC stream: a slice holds more points than it says")
    if kept < 0 or consumed(coder) > coder.state[4]:
        raise InputError(_DAMAGED)
    return _first_nodes(nodes, kept)


def _max_node_bytes(level: octree.Level, sensor: angular.Angular | None) -> int:
    counts = 0 if level.unique_points or not level.last else _LEAVES_BYTES
    direct = _DIRECT_BYTES + (_LASER_BYTES if sensor else 0)
    return _NODE_BYTES + (direct if level.idcm_mode else 0) + counts


def _sources(tree: Tree, header: GeometryHeader, gps: GeometryParameterSet) -> list[octree.Source]:
    starts = [np.empty(0, dtype=np.int32)] * len(tree.levels)
    leaves: Ints = np.empty(0, dtype=np.int64)
    if gps.inferred_direct_coding_mode:
        starts = leaf_starts(tree)
        leaves = leaf_codes(tree, header.tree_lvl_coded_axis_list)
    return [
        octree.Source(
            level.occupancy, level.first_child, start, leaves, tree.counts, tree.second_first
        )
        for level, start in zip(tree.levels, starts, strict=True)
    ]


def _levels(header: GeometryHeader, gps: GeometryParameterSet) -> list[octree.Level]:
    axes, boundary = header.tree_lvl_coded_axis_list, gps.neighbour_avail_boundary_log2_minus1
    mode, planar_enabled = gps.inferred_direct_coding_mode, bool(gps.geom_planar_mode_enabled_flag)
    mask = idcm.idcm_enable_mask(mode, planar_enabled, gps.geom_idcm_rate_minus1)
    levels = zip(node_sizes_log2(axes)[:-1], [7, *axes[:-1]], axes, strict=True)
    return [
        octree.Level(
            coded_axes=split,
            coded_axes_prev_level=above,
            node_size_log2=size,
            root=number == 0,
            last=number == len(axes) - 1,
            adjacent_child_ctx=bool(boundary and gps.adjacent_child_contextualization_enabled_flag),
            intra_pred=boundary > 0 and max(size) < gps.intra_pred_max_node_size_log2,
            unique_points=bool(gps.geom_unique_points_flag),
            idcm_mode=mode,
            joint_2pt_idcm=bool(gps.joint_2pt_idcm_enabled_flag),
            idcm_enable_mask=(mask >> number % 32 | mask << 32 - number % 32) & 0xFFFFFFFF,
        )
        for number, (size, above, split) in enumerate(levels)
    ]


def _initial_state(
    gps: GeometryParameterSet, depth: int, max_points: int, contexts: Contexts
) -> octree.SliceState:
    minus1 = gps.neighbour_avail_boundary_log2_minus1
    thresholds = (
        gps.geom_planar_threshold0,
        gps.geom_planar_threshold1,
        gps.geom_planar_threshold2,
    )
    return octree.SliceState(
        neighbours.borrowed_atlas(min(minus1 + 1, depth) if minus1 else 0),
        planar.planar_state(
            bool(gps.geom_planar_mode_enabled_flag),
            not gps.planar_buffer_disabled_flag,
            depth,
            thresholds,
        ),
        np.empty(max_points, dtype=np.int64),
        np.array([0, max_points or 1 << 62, 0, 0, 0], dtype=np.int64),
        idcm.empty_local_points(),
        contexts.ctx_idx_maps,
    )


def sensor_state(
    header: GeometryHeader, gps: GeometryParameterSet, axes: Three, origin: Three
) -> angular.Angular | None:
    """Return the state of the sensor at the beginning of a slice, or None without a sensor.

    Parameters
    ----------
    header, gps
        Header of the slice, and geometry parameter set.
    axes
        Indices of x, y and z among the coded axes.
    origin
        Origin of the slice.
    """
    if not gps.geom_angular_mode_enabled_flag:
        return None
    table = [(laser.theta, laser.z, laser.num_phi_per_turn) for laser in gps.lasers]
    elevation, height, turns = np.array(table, dtype=np.int64).T.copy()
    position = np.array(sensor_position(header, gps, axes, origin), dtype=np.int64)
    return angular.angular_state(elevation, height, turns, position)


def sensor_position(
    header: GeometryHeader, gps: GeometryParameterSet, axes: Three, origin: Three
) -> Three:
    """Return the sensor's position along the coded axes, relative to the slice's origin.

    The arguments are those of `sensor_state`.
    """
    x, y, z = header.gdu_angular_origin_xyz
    if not gps.geom_slice_angular_origin_present_flag:
        x, y, z = (a - b for a, b in zip(gps.gps_angular_origin_xyz, origin, strict=True))
    (_, s), (_, t), (_, v) = sorted(zip(axes, (x, y, z), strict=True))
    return s, t, v


def _root_parent() -> octree.Nodes:
    values = zip((0, 1, 0, 0, angular.NO_LASER), _NODE_TYPES, strict=True)
    return octree.Nodes(*(np.full(1, value, dtype) for value, dtype in values))


def _empty_nodes(count: int) -> octree.Nodes:
    return octree.Nodes(*(np.empty(count, dtype) for dtype in _NODE_TYPES))


def _first_nodes(nodes: octree.Nodes, count: int) -> octree.Nodes:
    return octree.Nodes._make(array[:count] for array in nodes)

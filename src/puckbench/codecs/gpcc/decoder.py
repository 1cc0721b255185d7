"""Decoding of one slice: a geometry data unit to points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from puckbench.codecs.gpcc import models, octree, planar
from puckbench.codecs.gpcc.arithmetic import Decoder, consumed, decoder, restart
from puckbench.codecs.gpcc.bits import Reader
from puckbench.codecs.gpcc.bypass import demultiplexed
from puckbench.codecs.gpcc.encoder import (
    empty_nodes,
    first_nodes,
    levels_of,
    root_parent,
    slice_state,
)
from puckbench.codecs.gpcc.syntax import (
    GeometryHeader,
    GeometryParameterSet,
    SequenceParameterSet,
    geometry_header,
    read_footer,
)
from puckbench.codecs.gpcc.tables import COUNT
from puckbench.codecs.gpcc.tree import node_bits
from puckbench.core.errors import InputError
from puckbench.geometry.morton import MOST_BITS, Ints

_DAMAGED = "G-PCC stream: a slice's data are damaged or truncated"


@dataclass(frozen=True)
class CodedSlice:
    """A data unit taken apart: header, arithmetic-coded data, number of points."""

    header: GeometryHeader
    data: bytes
    points: int


def read_slice(payload: bytes, sps: SequenceParameterSet, gps: GeometryParameterSet) -> CodedSlice:
    """Take a geometry data unit apart; InputError when it cannot be a slice."""
    reader = Reader(payload)
    header = GeometryHeader()
    geometry_header(reader, header, sps, gps)
    if 0 in header.tree_lvl_coded_axis_list:
        raise InputError("G-PCC stream: a level of the tree splits no axis")
    if max(node_bits(header.tree_lvl_coded_axis_list)[0]) > MOST_BITS:
        raise InputError(f"G-PCC stream: positions of more than {MOST_BITS} bits")
    body = payload[reader.position :]
    footer, length = read_footer(body, header, gps)
    return CodedSlice(header, body[: len(body) - length], footer.geom_num_points_minus1 + 1)


def decode_slice(
    coded: CodedSlice,
    sps: SequenceParameterSet,
    gps: GeometryParameterSet,
    adaptive: models.Models,
) -> Ints:
    """Morton codes (n,) of a slice's points; `adaptive` is left as the slice ends with it."""
    header = coded.header
    streams = header.geom_stream_cnt_minus1
    depth = len(header.tree_lvl_coded_axis_list)
    coder = _decoder(coded, sps)
    state = slice_state(gps, depth, coded.points)
    parents = root_parent()
    saved = models.copied(adaptive), state.planar.rates.copy()
    for number, level in enumerate(levels_of(header, gps)):
        if number == depth - 1 - streams:
            saved = models.copied(adaptive), state.planar.rates.copy()
        if streams and number > depth - 1 - streams:
            _next_stream(coder, adaptive, state, saved)
        planar.forget_planes(state.planar, 1 << number)
        parents = _decode_level(coder, adaptive, level, parents, state)
        if not len(parents.morton):
            break
    if state.tally[0] != coded.points:
        raise InputError("G-PCC stream: a slice holds fewer points than it says")
    return state.leaves


def _decoder(coded: CodedSlice, sps: SequenceParameterSet) -> Decoder:
    data = np.frombuffer(coded.data, dtype=np.uint8)
    if not sps.bypass_stream_enabled_flag:
        return decoder(data)
    if coded.header.geom_stream_cnt_minus1:
        raise InputError("G-PCC stream: several entropy streams with bypass are not supported")
    return decoder(*demultiplexed(data))


def _next_stream(
    coder: Decoder,
    adaptive: models.Models,
    state: octree.Slice,
    saved: tuple[models.Models, Ints],
) -> None:
    """Go on with the next entropy stream, from the contexts saved for it."""
    restart(coder)
    np.copyto(adaptive.probabilities, saved[0].probabilities)
    np.copyto(adaptive.maps, saved[0].maps)
    np.copyto(state.planar.rates, saved[1])


def _decode_level(
    coder: Decoder,
    adaptive: models.Models,
    level: octree.Level,
    parents: octree.Nodes,
    state: octree.Slice,
) -> octree.Nodes:
    count = int(COUNT[parents.occupancy].sum())
    nodes = empty_nodes(0 if level.last else count, encoding=False)
    kept = octree.code_level(coder, adaptive, level, parents, nodes, None, state)
    if kept == octree.TOO_MANY_POINTS:
        raise InputError("G-PCC stream: a slice holds more points than it says")
    if kept < 0 or consumed(coder) > coder.state[4]:
        raise InputError(_DAMAGED)
    return first_nodes(nodes, kept)

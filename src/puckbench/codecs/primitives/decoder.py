"""From a stream to points on planes, with their normals and the planes they lie on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.codecs.common.binary_coder import PAST_THE_END, POSITION
from puckbench.codecs.primitives import voxels
from puckbench.codecs.primitives.columns import NO_CHOICE
from puckbench.codecs.primitives.entropy import reader
from puckbench.codecs.primitives.layout import Bytes, Frame, Ints, Leaves, Nodes, Owners
from puckbench.codecs.primitives.manhattan_frame import rotation
from puckbench.codecs.primitives.revolved import (
    CONTEXTS,
    MIXERS,
    Round,
    code_round,
    points_on,
    unpacked,
)
from puckbench.codecs.primitives.stream import MOST_POINTS, MOST_ROUND_POINTS, Header, unpack
from puckbench.codecs.primitives.support import code_support
from puckbench.codecs.primitives.surface import count_points, fill
from puckbench.codecs.primitives.traversal import code_tree
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

_FINER_BY_LEVEL = 0.5
"""Planes of larger leaves are more precise, by the size to this power."""


class Decoded(NamedTuple):
    """What a stream holds.

    xyz: (m, 3) points in the cloud's coordinates. normals: (m, 3) unit normals, of any sign.
    planes: (m,) which plane each lies on; leaves share planes.
    """

    xyz: Floats
    normals: Floats
    planes: Ints


class Patches(NamedTuple):
    """A stream's planes, before points are made on them."""

    header: Header
    frame: Frame
    leaves: Leaves
    cover: Bytes
    rounds: list[tuple[Round, Bytes]]


def decode_stream(stream: bytes) -> Floats:
    """Points (m, 3) of a stream of surfaces or of voxels; InputError when it is damaged."""
    header, bits = unpack(stream)
    if isinstance(header, Header):
        return decode_surface(header, bits).xyz
    return voxels.decode(header.place, header.table, bits)


def decode_surface(header: Header, bits: bytes) -> Decoded:
    """Points of a stream; InputError when it is damaged."""
    return decoded_of(read_patches(header, bits))


def decoded_of(patches: Patches) -> Decoded:
    """Points of planes and of round surfaces; InputError for too many, or none."""
    xyz, rows = points_of(patches)
    planes = patches.leaves.plane[rows]
    normals = patches.leaves.planes[planes, :3] @ rotation(patches.header.turn)
    found = Decoded(xyz, normals, planes)
    return _joined([found, *points_of_rounds(patches)])


def points_of_rounds(patches: Patches) -> list[Decoded]:
    """Points of each round surface, numbered after the planes; InputError for too many."""
    header, found = patches.header, []
    columns = sum(int(bits.sum()) for _, bits in patches.rounds)
    if columns * header.fineness**2 > MOST_ROUND_POINTS:
        raise InputError(f"the stream is damaged ({columns} columns of round surfaces)")
    for k, (surface, bits) in enumerate(patches.rounds):
        cells, normals = points_on(surface, bits, header.fineness, header.spread)
        names = np.full(len(cells), int(patches.leaves.counts[1]) + k)
        found.append(Decoded(header.in_cloud(cells), normals @ rotation(header.turn), names))
    return found


def _joined(parts: list[Decoded]) -> Decoded:
    xyz, normals, planes = (np.concatenate(part) for part in zip(*parts, strict=True))
    if not 0 < len(xyz) <= MOST_POINTS:
        raise InputError(f"the stream is damaged ({len(xyz)} points)")
    return Decoded(xyz, normals, planes)


def points_of(patches: Patches) -> tuple[Floats, Ints]:
    """Points (m, 3) of planes in the cloud's coordinates and the leaves (m,) they lie on."""
    header = patches.header
    surface = (patches.frame, patches.leaves, patches.cover, header.fineness, header.spread)
    made = count_points(*surface)
    if made > MOST_POINTS:
        raise InputError(f"the stream is damaged ({made} points)")
    xyz, rows = np.empty((made, 3)), np.empty(made, np.int64)
    fill(*surface, xyz, rows)
    return header.in_cloud(xyz), rows


def read_patches(header: Header, bits: bytes) -> Patches:
    """Planes of a stream; InputError when it is damaged."""
    frame = frame_of(header)
    leaves, owner, cover = empty_leaves(header)
    coder = reader(bits, CONTEXTS, MIXERS)
    rounds = [
        (surface, np.zeros(int(surface.columns().sum()), np.uint8))
        for surface in unpacked(header.rounds)
    ]
    whole = code_tree(coder, frame, _NO_NODES, leaves, owner)
    if whole:
        code_support(coder, frame, leaves, owner, NO_CHOICE, cover)
        for surface, columns in rounds:
            code_round(coder, surface.columns(), columns)
    if not whole or coder.bits.registers[POSITION] > len(bits) + PAST_THE_END:
        raise InputError("the stream is damaged (it ends too early)")
    return Patches(header, frame, leaves, cover, rounds)


def frame_of(header: Header, price: float = 0.0) -> Frame:
    """The geometry of the tree, in cells."""
    below = np.maximum(header.finest - np.arange(header.depth + 1), 0)
    steps = header.step / 16 * 2.0 ** (-_FINER_BY_LEVEL * below)
    shape = np.array(header.shape, np.int64)
    return Frame(header.depth, header.finest, header.coarsest, shape, steps, price)


def empty_leaves(header: Header) -> tuple[Leaves, Owners, Bytes]:
    """Room for leaves, and grids: owners of least leaves (leaf + 1, 0 for none), cells' states."""
    n = header.leaves
    corner, side, plane = np.zeros((n, 3), np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
    leaves = Leaves(corner, side, plane, np.zeros((n, 4)), np.zeros(2, np.int64))
    down = header.depth - header.finest
    owner = np.zeros([((cells - 1) >> down) + 1 for cells in header.shape], np.int32)
    return leaves, owner, np.zeros(header.shape, np.uint8)


_NO_NODES = Nodes(
    np.zeros((1, 10)),
    np.zeros(2, np.int64),
    np.zeros(1, np.bool_),
    np.zeros(1, np.int64),
    np.zeros((1, 10)),
)

"""From a stream to points on planes, with their normals and the planes they lie on."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.primitives.columns import Evidence
from puckbench.codecs.primitives.entropy import POSITION, reader
from puckbench.codecs.primitives.stream import MOST_POINTS, Header
from puckbench.codecs.primitives.support import CONTEXTS, MIXERS, Choice, code_support
from puckbench.codecs.primitives.surface import count_points, fill
from puckbench.codecs.primitives.walk import Frame, Leaves, Nodes, code_tree
from puckbench.errors import InputError

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_PAST_THE_END = 8
_FINER_BY_LEVEL = 0.5
"""Planes of larger leaves are more precise, by the size to this power."""


class Decoded(NamedTuple):
    """Points (m, 3) in the cloud's coordinates, unit normals (m, 3), plane of each (m,)."""

    xyz: Floats
    normals: Floats
    labels: Ints


def decode_surface(header: Header, bits: bytes) -> Decoded:
    """Points of a stream; InputError when it is damaged."""
    frame = frame_of(header)
    leaves, owner, cover = empty_leaves(header)
    coder = reader(bits, CONTEXTS, MIXERS)
    whole = code_tree(coder, frame, _NO_NODES, leaves, owner)
    if whole:
        code_support(coder, frame, leaves, owner, _NO_CHOICE, cover)
    if not whole or coder.registers[POSITION] > len(bits) + _PAST_THE_END:
        raise InputError("the stream is damaged (it ends too early)")
    return _points(header, frame, leaves, cover)


def _points(header: Header, frame: Frame, leaves: Leaves, cover: Bytes) -> Decoded:
    made = count_points(frame, leaves, cover, header.fineness, header.spread)
    if not 0 < made <= MOST_POINTS:
        raise InputError(f"the stream is damaged ({made} points)")
    xyz, labels = np.empty((made, 3)), np.empty(made, np.int64)
    fill(frame, leaves, cover, header.fineness, header.spread, xyz, labels)
    return Decoded(xyz * header.unit + header.origin, leaves.planes[labels, :3], labels)


def frame_of(header: Header, price: float = 0.0) -> Frame:
    """The geometry of the tree, in cells."""
    below = np.maximum(header.finest - np.arange(header.depth + 1), 0)
    steps = header.step / 16 * 2.0 ** (-_FINER_BY_LEVEL * below)
    shape = np.array(header.shape, np.int64)
    return Frame(header.depth, header.finest, header.coarsest, 1.0, shape, steps, price)


def empty_leaves(header: Header) -> tuple[Leaves, NDArray[np.int32], Bytes]:
    """Room for leaves, and grids of the cells' owners (leaf + 1, 0 for none) and states."""
    n = header.leaves
    rows: list[Any] = [np.zeros((n, 3), np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)]
    leaves = Leaves(*rows, np.zeros((n, 4)), np.zeros(2, np.int64))
    owner = np.zeros(header.shape, np.int32)
    return leaves, owner, np.zeros(header.shape, np.uint8)


_NO_NODES = Nodes(
    np.zeros((1, 10)), np.zeros(2, np.int64), np.zeros(1, np.bool_), np.zeros(1, np.int64)
)
_NO_CHOICE = Choice(
    Evidence(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), np.zeros((1, 1, 1), np.int32), 1, 1, 1),
    0.0,
    0.0,
    0.0,
)

"""Which columns of a leaf's plane are surface: a bitmap, coded in the context of its surroundings.

A column is one finest cell wide, seen along the plane's dominant axis. Columns of all leaves share
a grid of the finest cells, so that a bitmap goes on where the neighbouring leaf's ended.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.primitives.columns import Evidence, choose, gain_at
from puckbench.codecs.primitives.entropy import Coder, code_bit
from puckbench.codecs.primitives.walk import CONTEXTS as TREE_CONTEXTS
from puckbench.codecs.primitives.walk import MIXERS as TREE_MIXERS
from puckbench.codecs.primitives.walk import Frame, Leaves
from puckbench.metrics.compiled import compiled

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


class Choice(NamedTuple):
    """What the encoder chooses columns by.

    missing: squared error of a sample that is left out. area: weight of the points in the place
    of a sample. smoothness: price of an edge.
    """

    evidence: Evidence
    missing: float
    area: float
    smoothness: float


_MIXER = TREE_MIXERS
_FACES = TREE_CONTEXTS
_AROUND = _FACES + 81 * 9
_COUNTS = _AROUND + 6561
CONTEXTS = _COUNTS + 16 * 9
MIXERS = TREE_MIXERS + 1


@compiled
def code_support(
    coder: Coder, frame: Frame, leaves: Leaves, owner: Ints, choice: Choice, cover: Bytes
) -> None:
    """Code the bitmaps of all leaves larger than a cell into `cover`: 0 no, 1 empty, 2 surface.

    wanted: the finest cells that hold samples, for the encoder (same shape as `cover`).
    """
    for i in range(leaves.counts[0]):
        if leaves.side[i] == 1:
            c = leaves.corner[i]
            cover[c[0], c[1], c[2]] = 2
    bits = np.zeros((256, 256), np.uint8)
    for i in range(leaves.counts[0]):
        side = leaves.side[i]
        if side == 1:
            continue
        if coder.registers[4] == 1:
            _wanted_columns(frame, leaves, i, owner, cover, choice, bits[:side, :side])
        _code_leaf(coder, frame, leaves, i, owner, bits[:side, :side], cover)


@compiled
def dominant(plane: Floats) -> int:
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    return axis


@compiled
def _wanted_columns(
    frame: Frame, leaves: Leaves, i: int, owner: Ints, cover: Bytes, choice: Choice, bits: Bytes
) -> None:
    """Choose the columns of a leaf: the error of its points against that of leaving them out."""
    evidence = choice.evidence
    corner, side = leaves.corner[i], leaves.side[i]
    plane = leaves.planes[leaves.plane[i]]
    axis = dominant(plane)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    gains = np.zeros((side, side))
    known = np.zeros((side + 2, side + 2), np.int64)
    at = np.zeros(3, np.int64)
    p = np.zeros(3)
    for a in range(side):
        for b in range(side):
            if not cell_of(frame, plane, axis, corner[u] + a, corner[v] + b, at):
                gains[a, b] = -1
                continue
            if at[axis] < corner[axis] or at[axis] >= corner[axis] + side:
                gains[a, b] = 0
                continue
            gain = 0.0
            for k in range(4):
                p[u] = (corner[u] + a + 0.25 + 0.5 * (k & 1)) * frame.cell
                p[v] = (corner[v] + b + 0.25 + 0.5 * (k >> 1)) * frame.cell
                p[axis] = (plane[3] - plane[u] * p[u] - plane[v] * p[v]) / plane[axis]
                gain += gain_at(evidence, p[0], p[1], p[2], choice.missing, choice.area)
            gains[a, b] = gain / 4 * (frame.cell / evidence.cell) ** 2
    for a in range(-1, side + 1):
        for b in range(-1, side + 1):
            if (0 <= a < side) != (0 <= b < side):
                known[a + 1, b + 1] = _state(
                    frame, plane, axis, corner[u] + a, corner[v] + b, i, owner, cover, at
                )
    choose(gains, choice.smoothness, known, bits)


@compiled
def _code_leaf(
    coder: Coder, frame: Frame, leaves: Leaves, i: int, owner: Ints, bits: Bytes, cover: Bytes
) -> None:
    plane = leaves.planes[leaves.plane[i]]
    axis = dominant(plane)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    corner, side = leaves.corner[i], leaves.side[i]
    at = np.zeros(3, np.int64)
    size = 0
    while (side >> (size + 1)) > 0:
        size += 1
    state = np.zeros(8, np.int64)
    for a in range(side):
        for b in range(side):
            if not cell_of(frame, plane, axis, corner[u] + a, corner[v] + b, at):
                continue
            if at[axis] < corner[axis] or at[axis] >= corner[axis] + side:
                continue
            x, y, z = at[0], at[1], at[2]
            n = 0
            for da in range(-1, 2):
                for db in range(-1, 2):
                    if da == 0 and db == 0:
                        continue
                    state[n] = _state(
                        frame, plane, axis, corner[u] + a + da, corner[v] + b + db, i, owner, cover, at
                    )
                    n += 1
            faces = state[1] + 3 * state[3] + 9 * state[4] + 27 * state[6]
            diagonal = state[0] + 3 * state[2] + 9 * state[5] + 27 * state[7]
            count = 0
            for k in range(8):
                count += state[k] == 2
            bit = code_bit(
                coder,
                bits[a, b],
                _MIXER,
                _FACES + faces + 81 * min(size - 1, 8),
                _AROUND + faces + 81 * diagonal,
                _COUNTS + 16 * count + size,
            )
            cover[x, y, z] = 2 if bit else 1


@compiled
def cell_of(frame: Frame, plane: Floats, axis: int, a: int, b: int, at: Ints) -> bool:
    """The finest cell in which the plane crosses the middle of a column; false outside the grid."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    if a < 0 or b < 0 or a >= frame.shape[u] or b >= frame.shape[v]:
        return False
    p_u, p_v = (a + 0.5) * frame.cell, (b + 0.5) * frame.cell
    height = (plane[3] - plane[u] * p_u - plane[v] * p_v) / plane[axis] / frame.cell
    if not 0 <= height < frame.shape[axis]:
        return False
    at[axis], at[u], at[v] = int(height), a, b
    return True


@compiled
def _state(
    frame: Frame, plane: Floats, axis: int, a: int, b: int, leaf: int, owner: Ints, cover: Bytes, at: Ints
) -> int:
    """0 unknown, 1 empty, 2 surface, of the column beside."""
    if not cell_of(frame, plane, axis, a, b, at):
        return 1
    state = cover[at[0], at[1], at[2]]
    if state > 0:
        return int(state)
    return 0 if owner[at[0], at[1], at[2]] > 0 else 1

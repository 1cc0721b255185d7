"""Which columns of a leaf's plane are surface: a bitmap, coded in the context of its surroundings.

A column is one finest cell wide, seen along the plane's dominant axis. Columns of all leaves share
a grid of the finest cells, so that a bitmap goes on where the neighbouring leaf's ended.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.primitives.entropy import Coder, code_bit
from puckbench.codecs.primitives.walk import Frame, Leaves
from puckbench.metrics.compiled import compiled

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]
CONTEXTS = 729 * 2 + 6561 + 16 * 9
MIXERS = 3


@compiled
def code_support(
    coder: Coder, frame: Frame, leaves: Leaves, owner: Ints, wanted: Bytes, cover: Bytes
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
            _wanted_columns(frame, leaves, i, wanted, bits[:side, :side])
        _code_leaf(coder, frame, leaves, i, owner, bits[:side, :side], cover)


@compiled
def dominant(plane: Floats) -> int:
    axis = 0
    for k in range(1, 3):
        if abs(plane[k]) > abs(plane[axis]):
            axis = k
    return axis


@compiled
def _wanted_columns(frame: Frame, leaves: Leaves, i: int, wanted: Bytes, bits: Bytes) -> None:
    """Columns that hold samples, small holes closed."""
    corner, side = leaves.corner[i], leaves.side[i]
    plane = leaves.planes[leaves.plane[i]]
    cell = np.zeros(3, np.int64)
    axis = dominant(plane)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    raw = np.zeros((side, side), np.uint8)
    at = np.zeros(3, np.int64)
    for a in range(side):
        for b in range(side):
            at[u], at[v] = corner[u] + a, corner[v] + b
            if at[u] >= frame.shape[u] or at[v] >= frame.shape[v]:
                continue
            if not _cell_of(frame, plane, axis, at[u], at[v], cell):
                continue
            height = cell[axis]
            for c in range(max(height - 1, 0), min(height + 2, frame.shape[axis])):
                at[axis] = c
                if wanted[at[0], at[1], at[2]]:
                    raw[a, b] = 1
                    break
    for a in range(side):
        for b in range(side):
            bits[a, b] = raw[a, b]
            if raw[a, b]:
                continue
            near = total = 0
            for da in range(-1, 2):
                for db in range(-1, 2):
                    if 0 <= a + da < side and 0 <= b + db < side and (da != 0 or db != 0):
                        total += 1
                        near += raw[a + da, b + db]
            if 8 * near > 5 * total:
                bits[a, b] = 1


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
            if not _cell_of(frame, plane, axis, corner[u] + a, corner[v] + b, at):
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
                0,
                faces + 81 * min(size - 1, 8),
                729 * 2 + faces + 81 * diagonal,
                729 * 2 + 6561 + 16 * count + size,
            )
            cover[x, y, z] = 2 if bit else 1


@compiled
def _cell_of(frame: Frame, plane: Floats, axis: int, a: int, b: int, at: Ints) -> bool:
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
    if not _cell_of(frame, plane, axis, a, b, at):
        return 1
    state = cover[at[0], at[1], at[2]]
    if state > 0:
        return int(state)
    return 0 if owner[at[0], at[1], at[2]] >= 0 else 1

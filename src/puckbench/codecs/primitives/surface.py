"""Points on the planes of leaves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.primitives.walk import Frame, Leaves
from puckbench.codecs.primitives.support import _cell_of
from puckbench.metrics.compiled import compiled

Ints = NDArray[np.int64]


@compiled
def fill(frame: Frame, leaves: Leaves, owner: Ints, fineness: int, margin: float, cover: NDArray[np.uint8], out: Floats) -> int:
    """Points at the centres of columns, `fineness` a cell, where the plane is in the cube."""
    count = 0
    at = np.zeros(3, np.int64)
    spacing = frame.cell / fineness
    for i in range(leaves.counts[0]):
        plane = leaves.planes[leaves.plane[i]]
        axis = 0
        for k in range(1, 3):
            if abs(plane[k]) > abs(plane[axis]):
                axis = k
        u, v = (axis + 1) % 3, (axis + 2) % 3
        low = leaves.corner[i] * frame.cell
        side = leaves.side[i] * frame.cell
        for a in range(leaves.side[i] * fineness):
            for b in range(leaves.side[i] * fineness):
                p_u, p_v = low[u] + (a + 0.5) * spacing, low[v] + (b + 0.5) * spacing
                c_u, c_v = leaves.corner[i, u] + a // fineness, leaves.corner[i, v] + b // fineness
                if leaves.side[i] > 1:
                    if not _cell_of(frame, plane, axis, c_u, c_v, at):
                        continue
                    if leaves.corner[i, axis] <= at[axis] < leaves.corner[i, axis] + leaves.side[i] and cover[at[0], at[1], at[2]] != 2:
                        continue
                height = (plane[3] - plane[u] * p_u - plane[v] * p_v) / plane[axis]
                if height < low[axis] - margin or height >= low[axis] + side + margin:
                    continue
                if height < low[axis] or height >= low[axis] + side:
                    p = np.empty(3, np.int64)
                    p[u], p[v] = int(p_u / frame.cell), int(p_v / frame.cell)
                    p[axis] = int(np.floor(height / frame.cell))
                    if p[axis] < 0 or p[axis] >= frame.shape[axis] or p[u]>=frame.shape[u] or p[v]>=frame.shape[v]:
                        continue
                    if owner[p[0], p[1], p[2]] >= 0:
                        continue
                if count == len(out):
                    return count
                out[count, axis], out[count, u], out[count, v] = height, p_u, p_v
                count += 1
    return count

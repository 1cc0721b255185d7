"""Which columns of a leaf's plane to keep: the fewest bits for the least error, by the samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.metrics.compiled import compiled

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

FARTHEST = 2


class Evidence(NamedTuple):
    """Samples to hold points against, found through a grid.

    xyz, normals: (n, 3). weights: (n,) shares of the points of the cloud. index: grid of rows by
    cell, -1 for none. cell: side. Errors: squared distance to the plane plus `across` times the
    squared distance to the point past a cell; more than `most` counts as `most`.
    """

    xyz: Floats
    normals: Floats
    weights: Floats
    index: Ints
    cell: float
    across: float
    most: float


@compiled
def gain_at(evidence: Evidence, x: float, y: float, z: float, missing: float, area: float) -> float:
    """What a point at x, y, z saves: the samples' error without it less its own error.

    missing: squared error of a sample that is left out, per cell of samples; area: weight of the
    point, per cell too.
    """
    cell = evidence.cell
    c = (int(x / cell), int(y / cell), int(z / cell))
    shape = evidence.index.shape
    nearest, found = 1e30, -1
    for i in range(max(c[0] - 2, 0), min(c[0] + 3, shape[0])):
        for j in range(max(c[1] - 2, 0), min(c[1] + 3, shape[1])):
            for k in range(max(c[2] - 2, 0), min(c[2] + 3, shape[2])):
                row = evidence.index[i, j, k]
                if row >= 0:
                    p = evidence.xyz[row]
                    squared = (p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2
                    if squared < nearest:
                        nearest, found = squared, row
    if found < 0:
        return -area * evidence.most
    p, n = evidence.xyz[found], evidence.normals[found]
    along = (x - p[0]) * n[0] + (y - p[1]) * n[1] + (z - p[2]) * n[2]
    beyond = max(np.sqrt(nearest) - cell, 0.0)
    error = min(along * along + evidence.across * beyond * beyond, evidence.most)
    saved = missing * evidence.weights[found] if beyond == 0.0 else 0.0
    return float(saved - area * error)


@compiled
def choose(gains: Floats, smoothness: float, known: Ints, bits: Bytes) -> None:
    """Bits of a bitmap: `gains` (n, n) of each, and `smoothness` for every pair of unlike ones.

    known: (n + 2, n + 2) states around: 1 empty, 2 surface, 0 not known. Iterated conditional
    modes (Besag 1986).
    """
    side = len(gains)
    for a in range(side):
        for b in range(side):
            bits[a, b] = 1 if gains[a, b] > 0 else 0
    for _ in range(4):
        changed = False
        for a in range(side):
            for b in range(side):
                pull = 0
                for k in range(4):
                    da = (k == 0) - (k == 1)
                    db = (k == 2) - (k == 3)
                    x, y = a + da, b + db
                    if 0 <= x < side and 0 <= y < side:
                        pull += 2 * bits[x, y] - 1
                    else:
                        state = known[x + 1, y + 1]
                        pull += (state == 2) - (state == 1)
                bit = 1 if gains[a, b] + smoothness * pull > 0 else 0
                if bit != bits[a, b]:
                    bits[a, b] = bit
                    changed = True
        if not changed:
            break

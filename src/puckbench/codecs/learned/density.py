"""How fine a cloud's grid may be for a network that is made for dense surfaces.

On a dense surface a voxel has about four occupied children; on a cloud that is thin on its grid
about one, whose place is chance. The authors of PCGCv1 and PCGCv2 code thin clouds at a smaller
scale, which they choose by hand; here the cloud itself chooses it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.sparse.voxels import AXIS_BITS, Keys, distinct, morton_keys

Voxels = NDArray[np.int64]
_FEWEST = 64
"""Coarser sets than this say nothing about density."""


def halvings(keys: Keys, children: float) -> int:
    """How often to halve the grid until voxels have so many children in the mean; 0 if never.

    keys: of distinct voxels, ascending. children: occupied, of a voxel of the next coarser grid.
    """
    counts = [len(keys)]
    for halved in range(AXIS_BITS):
        keys = distinct(keys >> 3)
        if len(keys) < _FEWEST:
            break
        counts.append(len(keys))
        if counts[halved] >= children * counts[halved + 1]:
            return halved
    return 0


def halvings_of(points: Floats, children: float) -> int:
    """The same of points (n, 3), n >= 1, on the grid of integers; 0 where they span too much."""
    if children <= 1:
        return 0
    voxels: Voxels = np.rint(points).astype(np.int64)
    voxels = voxels - voxels.min(axis=0)
    if voxels.max() >= 2**AXIS_BITS:
        return 0
    return halvings(distinct(morton_keys(voxels)), children)


def on_dense_grids(points: Floats, children: Sequence[float]) -> list[Voxels]:
    """The voxels of points (n, 3) on each of the grids that halvings for `children` lead to."""
    found = sorted({halvings_of(points, least) for least in children})
    return [np.unique(on_grid(points, k), axis=0) for k in found]


def on_grid(points: Floats, halved: int) -> Voxels:
    """The voxel (n, 3) of each point (n, 3) on the grid of integers, halved so many times."""
    voxels: Voxels = np.rint(np.ldexp(points, -halved)).astype(np.int64)
    return voxels

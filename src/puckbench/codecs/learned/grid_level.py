"""How fine a cloud's grid may be for a network that is made for dense surfaces.

On a dense surface a voxel has about four occupied children; on a cloud that is thin on its grid
about one, whose place is chance. The authors of PCGCv1 and PCGCv2 code thin clouds at a smaller
scale, which they choose by hand; here the cloud itself chooses it. Grids differ by quarters of a
halving: a voxel's side is the fourth root of two to a whole power.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.sparse.voxels import AXIS_BITS, Keys, distinct, morton_keys
from puckbench.geometry.cloud import Floats

Voxels = NDArray[np.int64]
QUARTERS = 4
"""Of a halving."""
_FEWEST = 64
"""Coarser sets than this say nothing about density."""


def halvings(keys: Keys, children: float) -> float:
    """How often to halve the grid until voxels have so many children in the mean; 0 if never.

    keys: of distinct voxels, ascending. children: occupied, of a voxel of the next coarser grid.
    From one halving to the next their number is taken to grow in a straight line.
    """
    before = 0.0
    for halved in range(AXIS_BITS):
        fine, keys = len(keys), distinct(keys >> 3)
        if len(keys) < _FEWEST:
            break
        mean = fine / len(keys)
        if mean >= children:
            return max(0.0, halved - (mean - children) / (mean - before))
        before = mean
    return 0.0


def halvings_of(points: Floats, children: float) -> float:
    """The same of points (n, 3), n >= 1, on the grid of integers; 0 where they span too much."""
    if children <= 1:
        return 0.0
    voxels: Voxels = np.rint(points).astype(np.int64)
    voxels = voxels - voxels.min(axis=0)
    if voxels.max() >= 2**AXIS_BITS:
        return 0.0
    return halvings(distinct(morton_keys(voxels)), children)


def on_dense_grids(points: Floats, children: Sequence[float]) -> list[Voxels]:
    """The voxels of points (n, 3) on each of the grids that whole halvings for `children` make."""
    found = sorted({math.ceil(halvings_of(points, least)) for least in children})
    return [np.unique(on_grid(points, QUARTERS * k), axis=0) for k in found]


def side_of(quarters: int) -> float:
    """A voxel's side on the grid of integers after so many quarters of a halving."""
    whole, rest = divmod(quarters, QUARTERS)
    return math.ldexp(math.sqrt(math.sqrt(2**rest)), whole)


def on_grid(points: Floats, quarters: int) -> Voxels:
    """The voxel (n, 3) of each point (n, 3) on that grid."""
    voxels: Voxels = np.rint(points / side_of(quarters)).astype(np.int64)
    return voxels

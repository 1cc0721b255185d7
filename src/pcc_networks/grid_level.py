"""Choice of the grid by the cloud's density.

On a dense surface, a voxel has about four occupied children. If the grid is too fine, it has about
one, in an unpredictable position; the authors of PCGCv1 and PCGCv2 coarsen such grids by hand.
Levels are in quarter octaves; an octave doubles the side of voxels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pcc_networks.sparse.voxels import AXIS_BITS, Keys, morton_keys, unique_keys
from pointkit.geometry.cloud import Floats

Voxels = NDArray[np.int64]
QUARTERS = 4
"""Levels per octave."""
MAX_QUARTER_OCTAVES = 80
"""Coarsest level in a stream."""
_MIN_VOXELS = 64
"""Minimum number of voxels from which the density is estimated."""


def octaves_to_density(keys: Keys, mean_occupied_children: float) -> float:
    """Return the octaves of coarsening, interpolated, after which a grid has the given density.

    The density is the mean number of voxels per parent. The result is 0 if no grid reaches it.
    Morton keys (n,) are sorted and distinct.
    """
    previous = 0.0
    for octave in range(AXIS_BITS):
        fine, keys = len(keys), unique_keys(keys >> 3)
        if len(keys) < _MIN_VOXELS:
            break
        mean = fine / len(keys)
        if mean >= mean_occupied_children:
            return max(0.0, octave - (mean - mean_occupied_children) / (mean - previous))
        previous = mean
    return 0.0


def octaves_of_points(points: Floats, mean_occupied_children: float) -> float:
    """Return `octaves_to_density` of points (n, 3) on the integer grid; 0 if over 2**20 wide."""
    if mean_occupied_children <= 1:
        return 0.0
    voxels: Voxels = np.rint(points).astype(np.int64)
    voxels = voxels - voxels.min(axis=0)
    if voxels.max() >= 2**AXIS_BITS:
        return 0.0
    return octaves_to_density(unique_keys(morton_keys(voxels)), mean_occupied_children)


def choose_grid_level(points: Floats, mean_occupied_children: float, offset: float = 0.0) -> int:
    """Choose how far to coarsen a cloud's grid to reach the density that the networks expect.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in steps of the finest grid.
    mean_occupied_children
        Mean number of voxels that a voxel of twice the side shall hold: about 4 on a dense surface.
        The finest grid is kept for 1 or less.
    offset
        Octaves added to the level of that density, negative for a finer grid; an octave doubles the
        side of a voxel.

    Returns
    -------
    int
        Level of the grid in quarter octaves above the finest one, from 0 to 80.
    """
    if mean_occupied_children <= 1:
        return 0
    octaves = octaves_of_points(points, mean_occupied_children) + offset
    return round(min(max(0.0, QUARTERS * octaves), MAX_QUARTER_OCTAVES))


def on_dense_grids(points: Floats, mean_occupied_children: Sequence[float]) -> list[Voxels]:
    """Return, for each density, voxels of points (n, 3) on the finest grid that reaches it.

    Grid steps are the input's step times powers of two; each grid is returned once.
    """
    octaves = {
        math.ceil(octaves_of_points(points, children)) for children in mean_occupied_children
    }
    return [np.unique(voxelised(points, QUARTERS * k), axis=0) for k in sorted(octaves)]


def voxel_size(quarter_octaves: int) -> float:
    """Return a level's voxel size in steps of the integer grid."""
    octaves, quarters = divmod(quarter_octaves, QUARTERS)
    return math.ldexp(math.sqrt(math.sqrt(2**quarters)), octaves)


def voxelised(points: Floats, quarter_octaves: int) -> Voxels:
    voxels: Voxels = np.rint(points / voxel_size(quarter_octaves)).astype(np.int64)
    return voxels

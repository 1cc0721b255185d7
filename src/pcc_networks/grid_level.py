"""Choice of a voxel grid that suits the density of a cloud.

On a dense surface, a voxel has about four occupied children. If the grid is too fine for the cloud,
a voxel has about one, in an unpredictable position. The authors of PCGCv1 and PCGCv2 coarsen such
grids by hand. The level of a grid is given in quarter octaves; an octave doubles the side of
voxels.
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
"""Number of grid levels per octave."""
MAX_QUARTER_OCTAVES = 80
"""Coarsest grid level that a stream can have."""
_MIN_VOXELS = 64
"""Minimum number of voxels from which the density is estimated."""


def octaves_to_density(keys: Keys, mean_occupied_children: float) -> float:
    """Return how far a grid must be coarsened until its voxels have a given density.

    Parameters
    ----------
    keys
        Morton keys (n,) of the voxels, sorted and distinct.
    mean_occupied_children
        The density: the mean number of voxels per voxel of twice the side.

    Returns
    -------
    float
        Octaves of coarsening, interpolated between whole octaves. The result is 0 if no grid
        reaches the density.
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
    """Return how far the integer grid of points (n, 3) must be coarsened to reach a density.

    The result is that of `octaves_to_density`. It is 0 if the points span 2**20 voxels or more.
    """
    if mean_occupied_children <= 1:
        return 0.0
    voxels: Voxels = np.rint(points).astype(np.int64)
    voxels = voxels - voxels.min(axis=0)
    if voxels.max() >= 2**AXIS_BITS:
        return 0.0
    return octaves_to_density(unique_keys(morton_keys(voxels)), mean_occupied_children)


def choose_grid_level(points: Floats, mean_occupied_children: float, offset: float = 0.0) -> int:
    """Choose how far to coarsen the grid of a cloud, to reach the density that the networks expect.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in steps of the finest grid.
    mean_occupied_children
        Mean number of voxels that a voxel of twice the side shall contain: about 4 on a dense
        surface. For 1 or less, the finest grid is kept.
    offset
        Octaves by which the grid is coarsened further, or refined if negative. An octave doubles
        the side of a voxel.

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
    """Return the voxels of a cloud on the finest grids that reach given densities.

    Parameters
    ----------
    points
        Points (n, 3), in steps of the integer grid.
    mean_occupied_children
        Densities, as in `choose_grid_level`.

    Returns
    -------
    list of ndarray
        Distinct voxels (m, 3) on each grid, the finest first. The step of each grid is a power of
        two. A grid that suits several densities is returned once.
    """
    octaves = {
        math.ceil(octaves_of_points(points, children)) for children in mean_occupied_children
    }
    return [np.unique(voxelised(points, QUARTERS * k), axis=0) for k in sorted(octaves)]


def voxel_size(quarter_octaves: int) -> float:
    """Return the side of a voxel at a grid level, in steps of the integer grid."""
    octaves, quarters = divmod(quarter_octaves, QUARTERS)
    return math.ldexp(math.sqrt(math.sqrt(2**quarters)), octaves)


def voxelised(points: Floats, quarter_octaves: int) -> Voxels:
    """Round points (n, 3) to voxels (n, 3) at a grid level."""
    voxels: Voxels = np.rint(points / voxel_size(quarter_octaves)).astype(np.int64)
    return voxels

"""Tangent planes of voxelised surfaces: a least-squares plane for each voxel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import SIZE, add_point, fit_plane

Ints = NDArray[np.int64]
_FEWEST = 4
"""Smallest number of voxels that a plane is fitted to."""
_BITS = 21


class Tangents(NamedTuple):
    """Planes fitted around m voxels, lengths in voxels.

    normals: (m, 3) unit vectors, (0, 0, 0) where there are too few voxels for a plane. off: (m,)
    signed distance of the voxel from its plane. thickness: (m,) root mean square distance of the
    fitted voxels. around: (m,) number of fitted voxels.
    """

    normals: Floats
    off: Floats
    thickness: Floats
    around: Floats


def tangents(voxels: Ints, block: int = 1) -> Tangents:
    """Fit a plane to each voxel's neighbourhood.

    Parameters
    ----------
    voxels
        Distinct voxels, (m, 3).
    block
        Side of a block in voxels. The neighbourhood of a voxel is its own block and the 26 blocks
        around it; the voxels of a block share one plane.
    """
    blocks = voxels // block
    blocks = blocks - blocks.min(axis=0) + 1
    keys = (blocks[:, 0] << 2 * _BITS) | (blocks[:, 1] << _BITS) | blocks[:, 2]
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1], [True]]))
    found = np.empty((len(voxels), 6))
    _fit(voxels[order].astype(np.float64), ordered[starts[:-1]], starts, found)
    back = np.empty_like(found)
    back[order] = found
    return Tangents(back[:, :3], back[:, 3], back[:, 4], back[:, 5])


@compiled
def _fit(xyz: Floats, keys: Ints, starts: Ints, found: Floats) -> None:
    """Write normal, distance, thickness and number of each voxel; blocks are sorted by keys."""
    ahead = np.zeros(9, np.int64)
    moments, plane = np.empty(SIZE), np.empty(4)
    for i in range(len(keys)):
        begin, end = starts[i], starts[i + 1]
        middle = xyz[begin]
        moments[:] = 0.0
        for row in range(9):
            low = keys[i] + ((row // 3 - 1) << 42) + ((row % 3 - 1) << 21) - 1
            while ahead[row] < len(keys) and keys[ahead[row]] < low:
                ahead[row] += 1
            j = ahead[row]
            while j < len(keys) and keys[j] <= low + 2:
                _add(xyz, starts[j], starts[j + 1], middle, moments)
                j += 1
        plane[:] = 0.0
        thickness = 0.0
        if moments[0] >= _FEWEST:
            thickness = np.sqrt(fit_plane(moments, plane) / moments[0])
        for k in range(begin, end):
            off = -plane[3]
            for a in range(3):
                off += plane[a] * (xyz[k, a] - middle[a])
                found[k, a] = plane[a]
            found[k, 3] = off
            found[k, 4] = thickness
            found[k, 5] = moments[0]


@compiled
def _add(xyz: Floats, begin: int, end: int, middle: Floats, moments: Floats) -> None:
    for k in range(begin, end):
        x, y, z = xyz[k, 0] - middle[0], xyz[k, 1] - middle[1], xyz[k, 2] - middle[2]
        add_point(moments, x, y, z, 1.0)

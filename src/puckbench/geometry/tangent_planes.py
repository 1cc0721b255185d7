"""Tangent planes of voxelised surfaces: a least-squares plane for each voxel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled, compiled_in_place
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
    _fit(voxels[order], ordered[starts[:-1]], starts, found)
    back = np.empty_like(found)
    back[order] = found
    return Tangents(back[:, :3], back[:, 3], back[:, 4], back[:, 5])


@compiled
def _fit(xyz: Ints, keys: Ints, starts: Ints, found: Floats) -> None:
    """Write normal, distance, thickness and number of each voxel; blocks are sorted by keys.

    Moments are whole numbers, about a voxel of the block, and therefore exact in any order.
    """
    of_blocks = _block_moments(xyz, starts)
    ahead = np.zeros(9, np.int64)
    sums, moments, plane = np.empty(SIZE, np.int64), np.empty(SIZE), np.empty(4)
    for i in range(len(keys)):
        begin, end = starts[i], starts[i + 1]
        middle = xyz[begin]
        sums[:] = 0
        for row in range(9):
            low = keys[i] + ((row // 3 - 1) << 42) + ((row % 3 - 1) << 21) - 1
            j = ahead[row]
            while j < len(keys) and keys[j] < low:
                j += 1
            ahead[row] = j
            while j < len(keys) and keys[j] <= low + 2:
                _add_shifted(of_blocks[j], xyz[starts[j]], middle, sums)
                j += 1
        plane[:] = 0.0
        thickness = 0.0
        if sums[0] >= _FEWEST:
            moments[:] = sums
            thickness = np.sqrt(fit_plane(moments, plane) / moments[0])
        for k in range(begin, end):
            off = -plane[3]
            for a in range(3):
                off += plane[a] * (xyz[k, a] - middle[a])
                found[k, a] = plane[a]
            found[k, 3] = off
            found[k, 4] = thickness
            found[k, 5] = sums[0]


@compiled
def _block_moments(xyz: Ints, starts: Ints) -> Ints:
    """Moments (m, 10) of the voxels of each block about its first one."""
    moments = np.zeros((len(starts) - 1, SIZE), np.int64)
    for i in range(len(moments)):
        begin = starts[i]
        for k in range(begin, starts[i + 1]):
            x, y, z = (
                xyz[k, 0] - xyz[begin, 0],
                xyz[k, 1] - xyz[begin, 1],
                xyz[k, 2] - xyz[begin, 2],
            )
            add_point(moments[i], x, y, z, 1)
    return moments


@compiled_in_place
def _add_shifted(moments: Ints, origin: Ints, middle: Ints, sums: Ints) -> None:
    """Add moments about `origin` (3,) to `sums`, which are about `middle` (3,)."""
    n, x, y, z = moments[0], moments[1], moments[2], moments[3]
    a, b, c = origin[0] - middle[0], origin[1] - middle[1], origin[2] - middle[2]
    sums[0] += n
    sums[1] += x + n * a
    sums[2] += y + n * b
    sums[3] += z + n * c
    sums[4] += moments[4] + (2 * x + n * a) * a
    sums[5] += moments[5] + x * b + (y + n * b) * a
    sums[6] += moments[6] + x * c + (z + n * c) * a
    sums[7] += moments[7] + (2 * y + n * b) * b
    sums[8] += moments[8] + y * c + (z + n * c) * b
    sums[9] += moments[9] + (2 * z + n * c) * c

"""Tangent planes of voxelised surfaces: a least-squares plane for each voxel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.core.threads import in_threads
from puckbench.geometry.cloud import Floats
from puckbench.geometry.moments import SIZE, add_point, fit_plane

Ints = NDArray[np.int64]
_FEWEST = 4
"""Smallest number of voxels that a plane is fitted to."""
_BITS = 21
_BLOCKS_PER_TASK = 16384
"""Blocks that a thread fits planes to at a time."""


class TangentPlanes(NamedTuple):
    """Planes fitted around m voxels, lengths in voxels.

    normals: (m, 3) unit vectors, (0, 0, 0) where there are too few voxels for a plane. off: (m,)
    signed distance of the voxel from its plane. thickness: (m,) root mean square distance of the
    fitted voxels. around: (m,) number of fitted voxels.
    """

    normals: Floats
    off: Floats
    thickness: Floats
    around: Floats


def fit_tangent_planes(voxels: Ints, block: int = 1) -> TangentPlanes:
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
    xyz, ordered = voxels[order], keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1], [True]]))
    occupied, of_blocks = ordered[starts[:-1]], _block_moments(xyz, starts)
    count = len(xyz)
    found = TangentPlanes(np.empty((count, 3)), np.empty(count), np.empty(count), np.empty(count))

    def fit(begin: int) -> None:
        rows = (begin, min(begin + _BLOCKS_PER_TASK, len(occupied)))
        _fit((xyz, order), (occupied, starts, of_blocks), rows, found)

    in_threads(fit, range(0, len(occupied), _BLOCKS_PER_TASK))
    return found


@compiled
def _fit(
    voxels: tuple[Ints, Ints],
    blocks: tuple[Ints, Ints, Ints],
    rows: tuple[int, int],
    found: TangentPlanes,
) -> None:
    """Write the planes of the voxels of blocks from rows[0] to before rows[1].

    voxels: their coordinates (m, 3) by blocks, and their places (m,) in what is written. blocks: in
    the order of their keys, these, where each begins (and the last ends), its moments.

    Moments are whole numbers, about a voxel of the block, and therefore exact in any order.
    """
    xyz, order = voxels
    keys, starts, of_blocks = blocks
    ahead = np.zeros(9, np.int64)
    for row in range(9):
        ahead[row] = np.searchsorted(keys, _first_beside(keys[rows[0]], row))
    sums, moments, plane = np.empty(SIZE, np.int64), np.empty(SIZE), np.empty(4)
    for i in range(rows[0], rows[1]):
        begin, end = starts[i], starts[i + 1]
        middle = xyz[begin]
        sums[:] = 0
        for row in range(9):
            low = _first_beside(keys[i], row)
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
            off, place = -plane[3], order[k]
            for a in range(3):
                off += plane[a] * (xyz[k, a] - middle[a])
                found.normals[place, a] = plane[a]
            found.off[place] = off
            found.thickness[place] = thickness
            found.around[place] = sums[0]


@compiled_in_place
def _first_beside(key: int, row: int) -> int:
    """Key of the first of three blocks, one after the other along z, in one of nine rows around."""
    return key + ((row // 3 - 1) << 2 * _BITS) + ((row % 3 - 1) << _BITS) - 1


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

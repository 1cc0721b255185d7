"""Planes that approximate the voxels around each voxel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats, Ints
from pointkit.geometry.moments import MOMENT_COUNT, add_point, fit_plane
from pointkit.threads import in_threads

_MIN_VOXELS = 4
_BITS = 21
"""Bits of a block coordinate in a key."""
_BLOCKS_PER_TASK = 16384


class TangentPlanes(NamedTuple):
    """Tangent planes at m voxels; lengths are in voxels.

    Parameters
    ----------
    normals
        Unit normals, (m, 3); 0 where there are too few voxels.
    distances
        Signed distance of each voxel from its plane, (m,).
    thickness
        Root mean square distance from the plane of the voxels to which it was fitted, (m,).
    counts
        Number of voxels to which each plane was fitted, (m,).
    """

    normals: Floats
    distances: Floats
    thickness: Floats
    counts: Floats


def fit_tangent_planes(voxels: Ints, block: int = 1) -> TangentPlanes:
    """Fit a plane to the neighbourhood of each voxel.

    Voxels are grouped in cubic blocks, and all voxels of a block share one plane. It is fitted to
    the voxels of the block and of the 26 blocks around it.

    Parameters
    ----------
    voxels
        Distinct voxels, (m, 3).
    block
        Side of a block, in voxels.

    Returns
    -------
    TangentPlanes
        One plane for each voxel, in the order of `voxels`.
    """
    blocks = voxels // block
    blocks = blocks - blocks.min(axis=0) + 1
    keys = (blocks[:, 0] << 2 * _BITS) | (blocks[:, 1] << _BITS) | blocks[:, 2]
    order = np.argsort(keys, kind="stable")
    xyz, ordered = voxels[order], keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1], [True]]))
    occupied, moments = ordered[starts[:-1]], _block_moments(xyz, starts)
    count = len(xyz)
    planes = TangentPlanes(np.empty((count, 3)), np.empty(count), np.empty(count), np.empty(count))

    def fit(begin: int) -> None:
        rows = (begin, min(begin + _BLOCKS_PER_TASK, len(occupied)))
        _fit((xyz, order), (occupied, starts, moments), rows, planes)

    in_threads(fit, range(0, len(occupied), _BLOCKS_PER_TASK))
    return planes


@compiled
def _fit(
    voxels: tuple[Ints, Ints],
    blocks: tuple[Ints, Ints, Ints],
    rows: tuple[int, int],
    planes: TangentPlanes,
) -> None:
    xyz, order = voxels
    keys, starts, block_moments = blocks
    cursors = np.zeros(9, np.int64)  # next block of each row of three neighbouring blocks
    for row in range(9):
        cursors[row] = np.searchsorted(keys, _first_key_in_row(keys[rows[0]], row))
    sums, moments, plane = np.empty(MOMENT_COUNT, np.int64), np.empty(MOMENT_COUNT), np.empty(4)
    for i in range(rows[0], rows[1]):
        begin, end = starts[i], starts[i + 1]
        middle = xyz[begin]
        sums[:] = 0
        for row in range(9):
            low = _first_key_in_row(keys[i], row)
            j = cursors[row]
            while j < len(keys) and keys[j] < low:
                j += 1
            cursors[row] = j
            while j < len(keys) and keys[j] <= low + 2:
                _add_shifted(block_moments[j], xyz[starts[j]], middle, sums)
                j += 1
        plane[:] = 0.0
        thickness = 0.0
        if sums[0] >= _MIN_VOXELS:
            moments[:] = sums
            thickness = np.sqrt(fit_plane(moments, plane) / moments[0])
        for k in range(begin, end):
            distance, place = -plane[3], order[k]
            for a in range(3):
                distance += plane[a] * (xyz[k, a] - middle[a])
                planes.normals[place, a] = plane[a]
            planes.distances[place] = distance
            planes.thickness[place] = thickness
            planes.counts[place] = sums[0]


@compiled_in_place
def _first_key_in_row(key: int, row: int) -> int:
    """Return the lowest key of one of the nine rows (0 to 8) of blocks around a block."""
    return key + ((row // 3 - 1) << 2 * _BITS) + ((row % 3 - 1) << _BITS) - 1


@compiled
def _block_moments(xyz: Ints, starts: Ints) -> Ints:
    moments = np.zeros((len(starts) - 1, MOMENT_COUNT), np.int64)
    for i in range(len(moments)):
        begin = starts[i]
        for k in range(begin, starts[i + 1]):
            x, y = xyz[k, 0] - xyz[begin, 0], xyz[k, 1] - xyz[begin, 1]
            add_point(moments[i], x, y, xyz[k, 2] - xyz[begin, 2], 1)
    return moments


@compiled_in_place
def _add_shifted(moments: Ints, origin: Ints, middle: Ints, sums: Ints) -> None:
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

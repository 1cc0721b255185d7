"""Points for decoded voxels: about as many as were coded, on the surface around each voxel.

A network codes a cloud on a grid on which it is dense, so that many points share a voxel. One point
for each voxel, in its middle, is then farther from them than it has to be: half a voxel along the
surface, and off it. Here a voxel has as many points as were in one in the mean, side by side on the
plane of the voxels around it; where the number is not whole, one more for voxels with the fewest
others around: the network has left others out there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.errors import InputError

Voxels = NDArray[np.int64]
PARTS = 8
"""Streams tell the points of a voxel in eighths."""
_MOST = 9
_ONTO = 0.3
"""How far a voxel moves onto the plane of those around it: noise makes surfaces thick."""
_ROWS = ((1,), (2,), (2, 1), (2, 2), (2, 1, 2), (2, 2, 2), (2, 3, 2), (3, 2, 3), (3, 3, 3))
"""How many points stand in each row of a voxel with 1, 2 (on the diagonal), 3, ... of them."""
_SPAN = 2**20
_MOST_POINTS = 2**22
"""Clouds of more points have one for each voxel: a damaged stream must not promise too many."""


def points_per_voxel(points: int, voxels: int, rho: float) -> int:
    """Eighths of a point for each of some voxels, so that they have so many together: 8 to 72.

    rho: voxels that the decoder keeps for each of them.
    """
    if points * rho > _MOST_POINTS:
        return PARTS
    return int(np.clip(PARTS * points // max(voxels, 1), PARTS, PARTS * _MOST))


def check_filling(eighths: int, voxels: int) -> None:
    """InputError where `points_per_voxel` cannot have said so of so many decoded voxels."""
    many = eighths > PARTS and voxels * eighths > 2 * _MOST_POINTS * PARTS  # each cube rounds
    if many or not PARTS <= eighths <= PARTS * _MOST:
        raise InputError("the stream is damaged (points of a voxel)")


def filled(voxels: Voxels, eighths: int) -> Floats:
    """Points (n, 3) for distinct voxels (m, 3), in voxels, n being about m * eighths / 8.

    With 8, one for each, they are the voxels, and so they are where these lie 2^20 apart.
    """
    from puckbench.codecs.tangents import tangents

    if eighths == PARTS or np.ptp(voxels, axis=0).max() >= _SPAN:
        return voxels.astype(np.float64)
    found = tangents(voxels)
    middles = voxels - (_ONTO * found.off)[:, None] * found.normals
    order = np.argsort(found.around, kind="stable")
    number, more = divmod(eighths, PARTS)
    several, rest = np.split(order, [len(voxels) * more // PARTS])
    parts = [(k, n) for k, n in ((several, number + 1), (rest, number)) if len(k)]
    return np.concatenate([_side_by_side(middles[k], found.normals[k], n) for k, n in parts])


def _side_by_side(middles: Floats, normals: Floats, number: int) -> Floats:
    """So many points (m * number, 3) around each middle (m, 3) of a voxel, across its normal."""
    rows = np.arange(len(middles))
    axis = np.abs(normals).argmax(axis=1)
    steep = np.where(normals[rows, axis] == 0, 1, normals[rows, axis])
    points = np.repeat(middles[:, None], number, axis=1)
    for across, offsets in zip((1, 2), _places(number), strict=True):
        other = (axis + across) % 3
        points[rows, :, other] += offsets
        points[rows, :, axis] -= (normals[rows, other] / steep)[:, None] * offsets
    return points.reshape(-1, 3)


def _places(number: int) -> Floats:
    """Where the points of a voxel stand, off its middle along two axes: (2, number), in voxels."""
    if number == 2:
        return np.array([[-0.25, 0.25], [-0.25, 0.25]])
    rows = _ROWS[number - 1]
    one = np.repeat(_middles(len(rows)), rows)
    return np.stack([one, np.concatenate([_middles(points) for points in rows])])


def _middles(parts: int) -> Floats:
    """The middles (parts,) of equal parts of a side."""
    return np.asarray((np.arange(parts) + 0.5) / parts - 0.5)

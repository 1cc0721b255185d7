"""Placement of points in decoded voxels, so that a decoded cloud has as many points as the input.

A decoder keeps the most likely voxels. In a sparse cloud, it knows that one or two of the 2x2x2
voxels of a block were occupied, but not which. In a dense cloud, several points share a voxel.
Therefore points are placed per block, side by side around the centroid of the occupancy
probabilities, and are projected onto the plane of the neighbouring blocks. In dense clouds, blocks
that are expected to have more voxels get more points. If the network is confident of the voxels
that it keeps, points are placed per voxel instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

Voxels = NDArray[np.int64]
Bools = NDArray[np.bool_]
UNITS = 256
"""Unit of points per voxel in streams: 1 / 256."""
_MAX_POINTS_PER_VOXEL = 9
_CONFIDENT = 0.8
"""A network is confident if kept voxels have at least this share of the sum of probabilities."""
_SPARSE, _DENSE = 1.2, 3.0
"""Limits of the mean number of kept voxels per block. Below the first, all blocks get equal numbers
of points; above the second, numbers that the probabilities predict; in between, a blend."""
_SHRINKAGE = 0.8
"""Shrinkage factor of a centroid's distance from its block's centre: networks are overconfident."""
_VOXEL_PROJECTION, _BLOCK_PROJECTION = 0.3, 0.5
"""Fraction of the distance to the local plane by which voxels or centroids move, against noise."""
_SUBDIVISION = 16
"""Steps, per side of a voxel or block, of the grid on which planes are fitted."""
_MAX_LOGIT = 50.0
"""Bound of logits, so that no probability is zero even for a damaged stream."""
_MAX_SPAN = 2**20
_MAX_POINTS = 2**22
"""Larger clouds have one point per voxel, so that damaged streams cannot demand too many points."""
CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)])
"""Positions (8, 3) of the voxels in a block, x fastest."""


class SiblingBlocks(NamedTuple):
    """Blocks of 2x2x2 voxels, with each voxel's occupancy probability and whether it is kept."""

    positions: Voxels  # (m, 3), distinct, in blocks
    probabilities: Floats  # (m, 8), of occupancy, in the order of `CORNERS`
    kept: Bools  # (m, 8), at least one in each row

    def voxels(self) -> Voxels:
        """Return the kept voxels (n, 3)."""
        block, corner = np.nonzero(self.kept)
        voxels: Voxels = 2 * self.positions[block] + CORNERS[corner]
        return voxels


def sibling_blocks(positions: Voxels, logits: NDArray[np.float32], kept: Bools) -> SiblingBlocks:
    """Return the blocks in which at least one voxel is kept.

    Parameters
    ----------
    positions
        Positions (m, 3) of the blocks, in blocks.
    logits
        Logits (m, 8) of the occupancy of each voxel, in the order of `CORNERS`.
    kept
        Whether each voxel is kept (m, 8).
    """
    from scipy.special import expit

    rows = kept.any(axis=1)
    clipped = np.clip(logits[rows].astype(np.float64), -_MAX_LOGIT, _MAX_LOGIT)
    return SiblingBlocks(positions[rows], np.nan_to_num(expit(clipped), nan=0.5), kept[rows])


def lossless_blocks(voxels: Voxels) -> SiblingBlocks:
    """Return the blocks of losslessly coded voxels (n, 3), whose probabilities are 0 or 1."""
    positions, block = np.unique(voxels // 2, axis=0, return_inverse=True)
    kept = np.zeros((len(positions), 8), dtype=bool)
    kept[block.ravel(), voxels % 2 @ [1, 2, 4]] = True
    return SiblingBlocks(positions, kept.astype(np.float64), kept)


def joined_blocks(parts: Sequence[SiblingBlocks]) -> SiblingBlocks:
    """Concatenate blocks."""
    positions, probabilities, kept = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    return SiblingBlocks(positions, probabilities, kept)


def points_per_voxel(points: int, voxels: int, rho: float) -> int:
    """Return how many points a decoder shall place in a voxel on average.

    Parameters
    ----------
    points
        Number of points of the input.
    voxels
        Number of occupied voxels of the input.
    rho
        Number of decoded voxels per occupied voxel.

    Returns
    -------
    int
        Points per voxel in 256ths, from 256 to 2304.
    """
    if points * rho > _MAX_POINTS:
        return UNITS
    return int(np.clip(UNITS * points // max(voxels, 1), UNITS, UNITS * _MAX_POINTS_PER_VOXEL))


def check_points_per_voxel(units: int, voxels: int) -> None:
    """Raise InputError if a stream has an impossible number of points per voxel.

    Parameters
    ----------
    units
        Points per voxel in 256ths, or 0 for one point in the centre of each voxel.
    voxels
        Number of decoded voxels.
    """
    too_many = units > UNITS and voxels * units > 2 * _MAX_POINTS * UNITS  # each cube rounds
    if too_many or (units and not UNITS <= units <= UNITS * _MAX_POINTS_PER_VOXEL):
        raise InputError("the stream is damaged (points of a voxel)")


def reconstructed_points(blocks: SiblingBlocks, units: int) -> Floats:
    """Place points in decoded blocks.

    Parameters
    ----------
    blocks
        The blocks with their kept voxels.
    units
        Points per voxel in 256ths, or 0 for one point in the centre of each voxel.

    Returns
    -------
    ndarray
        Points (n, 3), in voxels. Each voxel has one point in its centre if `units` is 0, if the
        voxels span 2**20 or more, or if `units` is 256 and the network is confident.
    """
    voxels = blocks.voxels().astype(np.float64)
    if not units or np.ptp(voxels, axis=0).max() >= _MAX_SPAN:
        return voxels
    probabilities = blocks.probabilities
    confidence = probabilities[blocks.kept].sum() / probabilities.sum()
    if confidence >= _CONFIDENT:
        counts = np.full(len(voxels), units / UNITS)
        return voxels if units == UNITS else _placed(voxels, counts, _VOXEL_PROJECTION)
    expected = probabilities.sum(axis=1)
    centroids = probabilities @ (CORNERS - 0.5) / (2 * expected[:, None])
    kept = len(voxels) / len(expected)
    trust = np.clip((kept - _SPARSE) / (_DENSE - _SPARSE), 0, 1)
    counts = kept * units / UNITS * (1 + trust * (expected / expected.mean() - 1))
    points = _placed(blocks.positions + _SHRINKAGE * centroids, counts, _BLOCK_PROJECTION)
    return 2 * points + 0.5


def _placed(centres: Floats, counts: Floats, projection: float) -> Floats:
    """Place about `counts` (m,) points side by side around each centre (m, 3), on local planes."""
    from pointkit.geometry.tangent_planes import fit_tangent_planes

    voxels = np.rint(_SUBDIVISION * (centres + 0.5)).astype(np.int64)
    planes = fit_tangent_planes(voxels, _SUBDIVISION)
    projected = centres - (projection / _SUBDIVISION * planes.distances)[:, None] * planes.normals
    whole = _whole_counts(counts, planes.counts)
    parts = [(whole == count, int(count)) for count in np.unique(whole)]
    return np.concatenate([_on_plane(projected[k], planes.normals[k], n) for k, n in parts])


def _whole_counts(counts: Floats, neighbour_counts: Floats) -> NDArray[np.int64]:
    """Round counts (m,) to integers of at least 1, upwards where a centre has few neighbours."""
    whole = np.floor(counts)
    remainder = int(np.rint(counts.sum()) - whole.sum())
    whole[np.argsort(neighbour_counts, kind="stable")[:remainder]] += 1
    return np.clip(whole, 1, 8 * _MAX_POINTS_PER_VOXEL).astype(np.int64)


def _on_plane(centres: Floats, normals: Floats, count: int) -> Floats:
    rows = np.arange(len(centres))
    axis = np.abs(normals).argmax(axis=1)
    steep = np.where(normals[rows, axis] == 0, 1, normals[rows, axis])
    points = np.repeat(centres[:, None], count, axis=1)
    for across, offsets in zip((1, 2), _square_pattern(count), strict=True):
        other = (axis + across) % 3
        points[rows, :, other] += offsets
        points[rows, :, axis] -= (normals[rows, other] / steep)[:, None] * offsets
    return points.reshape(-1, 3)


def _square_pattern(count: int) -> Floats:
    """Return offsets (2, count) that are spread evenly over a centred square of side 1."""
    if count == 2:
        return np.array([[-0.25, 0.25], [-0.25, 0.25]])
    rows = int(np.ceil(np.sqrt(count)))
    few, more = divmod(count, rows)
    in_row = np.full(rows, few)
    in_row[((np.arange(more) + 0.5) * rows / max(more, 1)).astype(int)] += 1
    first = np.repeat(_midpoints(rows), in_row)
    return np.stack([first, np.concatenate([_midpoints(points) for points in in_row])])


def _midpoints(parts: int) -> Floats:
    return np.asarray((np.arange(parts) + 0.5) / parts - 0.5)

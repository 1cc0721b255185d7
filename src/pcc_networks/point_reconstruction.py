"""Point reconstruction for voxel codecs: place as many points as the input had.

A decoder keeps the most likely voxels. In a sparse cloud it knows only that one or two voxels of a
2x2x2 block of siblings were occupied, not which; in a dense cloud several points share a voxel.
Therefore points are placed per block, side by side around the centroid of the occupancy
probabilities, projected onto the plane of the neighbouring blocks. In dense clouds, blocks that are
expected to have more voxels get more points. If the network is confident of the kept voxels, points
are placed per voxel.
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
    """Blocks of 2x2x2 sibling voxels, with the voxels that a decoder keeps."""

    positions: Voxels  # (m, 3), distinct, in blocks
    probabilities: Floats  # (m, 8), of occupancy, in the order of `CORNERS`
    kept: Bools  # (m, 8), at least one in each row

    def voxels(self) -> Voxels:
        block, corner = np.nonzero(self.kept)
        voxels: Voxels = 2 * self.positions[block] + CORNERS[corner]
        return voxels


def sibling_blocks(positions: Voxels, logits: NDArray[np.float32], kept: Bools) -> SiblingBlocks:
    """Return blocks with kept voxels, from positions (m, 3), logits (m, 8) and `kept` (m, 8)."""
    from scipy.special import expit

    rows = kept.any(axis=1)
    clipped = np.clip(logits[rows].astype(np.float64), -_MAX_LOGIT, _MAX_LOGIT)
    return SiblingBlocks(positions[rows], np.nan_to_num(expit(clipped), nan=0.5), kept[rows])


def lossless_blocks(voxels: Voxels) -> SiblingBlocks:
    positions, block = np.unique(voxels // 2, axis=0, return_inverse=True)
    kept = np.zeros((len(positions), 8), dtype=bool)
    kept[block.ravel(), voxels % 2 @ [1, 2, 4]] = True
    return SiblingBlocks(positions, kept.astype(np.float64), kept)


def joined_blocks(parts: Sequence[SiblingBlocks]) -> SiblingBlocks:
    positions, probabilities, kept = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    return SiblingBlocks(positions, probabilities, kept)


def points_per_voxel(points: int, voxels: int, rho: float) -> int:
    """Return the number of points to place per decoded voxel, in 256ths (256 to 2304).

    The input has `points` points in `voxels` voxels; the decoder keeps `rho` times as many voxels.
    """
    if points * rho > _MAX_POINTS:
        return UNITS
    return int(np.clip(UNITS * points // max(voxels, 1), UNITS, UNITS * _MAX_POINTS_PER_VOXEL))


def check_points_per_voxel(units: int, voxels: int) -> None:
    """Raise InputError if `points_per_voxel` cannot return `units`; 0 (voxel centres) is valid."""
    too_many = units > UNITS and voxels * units > 2 * _MAX_POINTS * UNITS  # each cube rounds
    if too_many or (units and not UNITS <= units <= UNITS * _MAX_POINTS_PER_VOXEL):
        raise InputError("the stream is damaged (points of a voxel)")


def reconstructed_points(blocks: SiblingBlocks, units: int) -> Floats:
    """Return points (n, 3), in voxels, for the decoded blocks.

    `units` is the number of points per voxel in 256ths. Each voxel has one point in its centre if
    `units` is 0, the voxels span 2**20 or more, or the network is confident and `units` is 256.
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
    """Place about `counts` (m,) points side by side around centres (m, 3), on local planes.

    Centres lie within 1/2 of distinct integer positions; planes are fitted to adjacent centres.
    """
    from pointkit.geometry.tangent_planes import fit_tangent_planes

    voxels = np.rint(_SUBDIVISION * (centres + 0.5)).astype(np.int64)
    planes = fit_tangent_planes(voxels, _SUBDIVISION)
    projected = centres - (projection / _SUBDIVISION * planes.distances)[:, None] * planes.normals
    whole = _whole_counts(counts, planes.counts)
    parts = [(whole == count, int(count)) for count in np.unique(whole)]
    return np.concatenate([_on_plane(projected[k], planes.normals[k], n) for k, n in parts])


def _whole_counts(counts: Floats, neighbour_counts: Floats) -> NDArray[np.int64]:
    """Round counts (m,) to integers of at least 1, with about the same sum.

    Counts are rounded up at the centres with the fewest neighbours, where voxels were lost.
    """
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
    """Return offsets (2, count) spread evenly over a centred square of side 1."""
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

"""Point reconstruction for voxel codecs: as many points as the input had, from occupancy.

A network predicts the probability that a voxel is occupied, and a decoder keeps the most likely
voxels, as many as there were. One point in the centre of each is farther from the cloud than it has
to be: where a cloud is sparse on its grid the network cannot know which voxels of a 2x2x2 block of
siblings were occupied, only that one or two were; and where it is dense, several points share a
voxel. So points are placed for blocks: as many as a block held in the mean, more where more are
expected, side by side at the centroid of the block's occupancy probabilities, projected onto the
plane of the neighbouring blocks. Where the network is confident of its voxels, points are placed
for voxels instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

Voxels = NDArray[np.int64]
Bools = NDArray[np.bool_]
UNITS = 256
"""Streams hold the points of a voxel in such fractions."""
_MAX_POINTS_PER_VOXEL = 9
_CONFIDENT = 0.8
"""Share of the occupancy probabilities in voxels that are kept, from which on a network is
confident of its voxels."""
_SPARSE, _DENSE = 1.2, 3.0
"""Mean voxels of a block at which its own probabilities say nothing, and everything, about its
number of points."""
_SHRINKAGE = 0.8
"""Factor of a centroid's distance from its block's centre: networks are overconfident."""
_VOXEL_PROJECTION, _BLOCK_PROJECTION = 0.3, 0.5
"""How far a point moves onto the plane of its neighbours, which noise puts it beside."""
_SUBDIVISION = 16
"""Subdivisions of a side on which planes are fitted."""
_MAX_LOGIT = 50.0
"""No probability is zero, whatever a damaged stream makes of a network."""
_MAX_SPAN = 2**20
_MAX_POINTS = 2**22
"""Clouds of more points have one for each voxel: a damaged stream must not promise too many."""
CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)])
"""The voxels of a block, x fastest."""


class SiblingBlocks(NamedTuple):
    """Blocks of 2x2x2 voxels, of each of which a decoder keeps some.

    Parameters
    ----------
    positions
        (m, 3), distinct, in blocks.
    probabilities
        (m, 8), of occupancy, in the order of `CORNERS`.
    kept
        (m, 8), at least one in each row.
    """

    positions: Voxels
    probabilities: Floats
    kept: Bools

    def voxels(self) -> Voxels:
        """The voxels that are kept (n, 3)."""
        block, corner = np.nonzero(self.kept)
        found: Voxels = 2 * self.positions[block] + CORNERS[corner]
        return found


def sibling_blocks(positions: Voxels, logits: NDArray[np.float32], kept: Bools) -> SiblingBlocks:
    """The blocks that keep any voxel, by positions (m, 3), logits (m, 8) and kept (m, 8)."""
    from scipy.special import expit

    rows = kept.any(axis=1)
    clipped = np.clip(logits[rows].astype(np.float64), -_MAX_LOGIT, _MAX_LOGIT)
    return SiblingBlocks(positions[rows], np.nan_to_num(expit(clipped), nan=0.5), kept[rows])


def known_blocks(voxels: Voxels) -> SiblingBlocks:
    """The blocks of distinct voxels (n, 3) that were coded without loss."""
    positions, block = np.unique(voxels // 2, axis=0, return_inverse=True)
    kept = np.zeros((len(positions), 8), dtype=bool)
    kept[block.ravel(), voxels % 2 @ [1, 2, 4]] = True
    return SiblingBlocks(positions, kept.astype(np.float64), kept)


def concatenated(parts: Sequence[SiblingBlocks]) -> SiblingBlocks:
    """The blocks of all parts, of which there is at least one."""
    positions, probabilities, kept = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    return SiblingBlocks(positions, probabilities, kept)


def points_per_voxel(points: int, voxels: int, rho: float) -> int:
    """Points of each decoded voxel, in 256ths (256 to 2304).

    Parameters
    ----------
    points
        Points of the input.
    voxels
        Voxels that they occupy.
    rho
        Decoded voxels for each of these.
    """
    if points * rho > _MAX_POINTS:
        return UNITS
    return int(np.clip(UNITS * points // max(voxels, 1), UNITS, UNITS * _MAX_POINTS_PER_VOXEL))


def check_points_per_voxel(units: int, voxels: int) -> None:
    """Raise InputError for points of a voxel that `points_per_voxel` cannot have returned.

    0 is allowed: it stands for one point in the centre of each voxel.
    """
    many = units > UNITS and voxels * units > 2 * _MAX_POINTS * UNITS  # each cube rounds
    if many or (units and not UNITS <= units <= UNITS * _MAX_POINTS_PER_VOXEL):
        raise InputError("the stream is damaged (points of a voxel)")


def reconstructed_points(blocks: SiblingBlocks, units: int) -> Floats:
    """Points for the voxels that are kept.

    Parameters
    ----------
    blocks
        The decoded voxels.
    units
        Points of a voxel, in 256ths. With 0 each voxel has one point in its centre, as also where
        voxels lie 2**20 apart, or the network is confident of voxels with one point each.

    Returns
    -------
    NDArray
        (n, 3), in voxels.
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
    """Points side by side around centres (m, 3), on the planes of the centres around.

    The centres lie within 1/2 of distinct integers; counts (m,) are the points wanted of each.
    """
    from puckbench.geometry.tangent_planes import fit_tangent_planes

    voxels = np.rint(_SUBDIVISION * (centres + 0.5)).astype(np.int64)
    found = fit_tangent_planes(voxels, _SUBDIVISION)
    moved = centres - (projection / _SUBDIVISION * found.distances)[:, None] * found.normals
    whole = _whole_counts(counts, found.counts)
    parts = [(whole == count, int(count)) for count in np.unique(whole)]
    return np.concatenate([_on_plane(moved[k], found.normals[k], n) for k, n in parts])


def _whole_counts(counts: Floats, around: Floats) -> NDArray[np.int64]:
    """Integers for counts (m,), at least one each, with about the same sum.

    The remainder goes to those with the fewest others around, where others were not kept.
    """
    whole = np.floor(counts)
    left = int(np.rint(counts.sum()) - whole.sum())
    whole[np.argsort(around, kind="stable")[:left]] += 1
    return np.clip(whole, 1, 8 * _MAX_POINTS_PER_VOXEL).astype(np.int64)


def _on_plane(centres: Floats, normals: Floats, count: int) -> Floats:
    """Points (m * count, 3) around centres (m, 3), on the planes with these normals (m, 3)."""
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
    """Evenly spread places on a square of side 1, relative to its centre: (2, count)."""
    if count == 2:
        return np.array([[-0.25, 0.25], [-0.25, 0.25]])
    rows = int(np.ceil(np.sqrt(count)))
    few, more = divmod(count, rows)
    in_row = np.full(rows, few)
    in_row[((np.arange(more) + 0.5) * rows / max(more, 1)).astype(int)] += 1
    first = np.repeat(_midpoints(rows), in_row)
    return np.stack([first, np.concatenate([_midpoints(points) for points in in_row])])


def _midpoints(parts: int) -> Floats:
    """Midpoints (parts,) of equal parts of a side, relative to its middle."""
    return np.asarray((np.arange(parts) + 0.5) / parts - 0.5)

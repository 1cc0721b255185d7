"""Points for decoded voxels: about as many as were coded, where the network expects them.

A network says of each voxel how likely it is occupied; a decoder keeps the likeliest, as many as
there were. One point in the middle of each is farther from the cloud than it has to be: where a
cloud is thin on its grid the network cannot know which of the voxels of a block of 2 x 2 x 2 were
occupied, only that one or two were; and where it is dense, several points share a voxel. So here
points belong to a block: as many as were in one in the mean, more where more are expected, side by
side around the place that is expected, on the plane of the blocks around. Where the network is sure
of its voxels they belong to these instead.
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
PARTS = 256
"""Streams tell the points of a voxel in such parts."""
_MOST = 9
"""Points of a voxel."""
_SURE = 0.8
"""Share of the chances that is kept from which on the network is sure of its voxels."""
_THIN, _DENSE = 1.2, 3.0
"""Voxels of a block, in the mean, at which its own chances say nothing, and all, of its points."""
_MODESTY = 0.8
"""How far towards the place that a network expects: networks are surer than they should be."""
_ONTO_VOXELS, _ONTO_BLOCKS = 0.3, 0.5
"""How far a point moves onto the plane of those around it: noise makes surfaces thick."""
_FINE = 16
"""Parts of a side in which places are told when planes are laid through them."""
_MOST_LOGIT = 50.0
"""No chance is zero, whatever a damaged stream makes of a network."""
_SPAN = 2**20
_MOST_POINTS = 2**22
"""Clouds of more points have one for each voxel: a damaged stream must not promise too many."""
CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)])
"""The voxels of a block, x fastest."""


class Octets(NamedTuple):
    """Blocks of 2 x 2 x 2 voxels, those in which a decoder keeps some.

    places: (m, 3), distinct, in blocks. chances: (m, 8), that a voxel is occupied, in the order of
    `CORNERS`. kept: (m, 8), at least one in each row.
    """

    places: Voxels
    chances: Floats
    kept: Bools

    def voxels(self) -> Voxels:
        """Those that are kept (n, 3)."""
        block, corner = np.nonzero(self.kept)
        found: Voxels = 2 * self.places[block] + CORNERS[corner]
        return found


def octets(places: Voxels, logits: NDArray[np.float32], kept: Bools) -> Octets:
    """Those of some blocks (m, 3) that keep any of their voxels, which have these logits (m, 8)."""
    from scipy.special import expit

    rows = kept.any(axis=1)
    chances = expit(np.clip(logits[rows].astype(np.float64), -_MOST_LOGIT, _MOST_LOGIT))
    return Octets(places[rows], np.nan_to_num(chances, nan=0.5), kept[rows])


def certain(voxels: Voxels) -> Octets:
    """The blocks of distinct voxels (n, 3) that are known."""
    places, block = np.unique(voxels // 2, axis=0, return_inverse=True)
    kept = np.zeros((len(places), 8), dtype=bool)
    kept[block.ravel(), voxels % 2 @ [1, 2, 4]] = True
    return Octets(places, kept.astype(np.float64), kept)


def together(parts: Sequence[Octets]) -> Octets:
    """The blocks of all of some, one at least."""
    places, chances, kept = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Octets(places, chances, kept)


def points_per_voxel(points: int, voxels: int, rho: float) -> int:
    """256ths of a point for each of some voxels, so that they have so many together: 256 to 2304.

    rho: voxels that the decoder keeps for each of them.
    """
    if points * rho > _MOST_POINTS:
        return PARTS
    return int(np.clip(PARTS * points // max(voxels, 1), PARTS, PARTS * _MOST))


def check_filling(parts: int, voxels: int) -> None:
    """InputError where `points_per_voxel` cannot have said so of so many decoded voxels.

    0 is allowed: streams say so where voxels decode to their middles.
    """
    many = parts > PARTS and voxels * parts > 2 * _MOST_POINTS * PARTS  # each cube rounds
    if many or (parts and not PARTS <= parts <= PARTS * _MOST):
        raise InputError("the stream is damaged (points of a voxel)")


def filled(blocks: Octets, parts: int) -> Floats:
    """Points (n, 3), in voxels, for the voxels that are kept, n being about parts / 256 as many.

    With 0 they are these voxels, and so they are where these lie 2^20 apart, or where the network
    is sure of each and it has one point.
    """
    voxels = blocks.voxels().astype(np.float64)
    if not parts or np.ptp(voxels, axis=0).max() >= _SPAN:
        return voxels
    chances = blocks.chances
    sure = chances[blocks.kept].sum() / chances.sum()
    if sure >= _SURE:
        each = np.full(len(voxels), parts / PARTS)
        return voxels if parts == PARTS else _spread(voxels, each, _ONTO_VOXELS)
    expected = chances.sum(axis=1)
    aside = chances @ (CORNERS - 0.5) / (2 * expected[:, None])
    kept = len(voxels) / len(expected)
    trust = np.clip((kept - _THIN) / (_DENSE - _THIN), 0, 1)
    shares = kept * parts / PARTS * (1 + trust * (expected / expected.mean() - 1))
    points = _spread(blocks.places + _MODESTY * aside, shares, _ONTO_BLOCKS)
    return 2 * points + 0.5


def _spread(middles: Floats, shares: Floats, onto: float) -> Floats:
    """Points side by side around middles (m, 3) that lie within half of 1 of different integers.

    shares: (m,), how many points there should be around each. onto: how far they move onto the
    plane of the middles around.
    """
    from puckbench.geometry.tangent_planes import tangents

    found = tangents(np.rint(_FINE * (middles + 0.5)).astype(np.int64), _FINE)
    moved = middles - (onto / _FINE * found.off)[:, None] * found.normals
    numbers = _numbers(shares, found.around)
    parts = [(numbers == number, int(number)) for number in np.unique(numbers)]
    return np.concatenate([_side_by_side(moved[k], found.normals[k], n) for k, n in parts])


def _numbers(shares: Floats, around: Floats) -> NDArray[np.int64]:
    """Whole numbers for shares (m,), at least one each, together about as many.

    What is left goes to those with the fewest others around: the network has left others out there.
    """
    whole = np.floor(shares)
    left = int(np.rint(shares.sum()) - whole.sum())
    whole[np.argsort(around, kind="stable")[:left]] += 1
    return np.clip(whole, 1, 8 * _MOST).astype(np.int64)


def _side_by_side(middles: Floats, normals: Floats, number: int) -> Floats:
    """So many points (m * number, 3) around each middle (m, 3), across its normal."""
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
    """Where so many points stand on a square of side 1, off its middle: (2, number)."""
    if number == 2:
        return np.array([[-0.25, 0.25], [-0.25, 0.25]])
    rows = int(np.ceil(np.sqrt(number)))
    few, more = divmod(number, rows)
    many = np.full(rows, few)
    many[((np.arange(more) + 0.5) * rows / max(more, 1)).astype(int)] += 1
    one = np.repeat(_middles(rows), many)
    return np.stack([one, np.concatenate([_middles(points) for points in many])])


def _middles(parts: int) -> Floats:
    """The middles (parts,) of equal parts of a side."""
    return np.asarray((np.arange(parts) + 0.5) / parts - 0.5)

"""Voxels moved along the normals of their surroundings, as far as the encoder found to be right.

A voxel on a wall is more often passed through on the side where the wall is: noise thins out away
from it, and a coarse voxel is cut by it off its middle. How far a voxel should move depends on how
far it is off the plane of the voxels around it and on how thick these lie; the encoder sends the
mean for each class of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.primitives.layout import Ints
from puckbench.codecs.primitives.moments import SIZE, add_point, fit_plane
from puckbench.codecs.primitives.stream import BINS, BLOCKS, Table
from puckbench.compiling import compiled

_DISTANCES = np.array([0.25, 0.5, 0.75, 1.0, 1.5])
_THICKNESSES = np.array([0.3, 0.5, 0.9])
_ONE = 64
_FEWEST = 4
"""Voxels around that make a plane."""
_BITS = 21


class Surroundings(NamedTuple):
    """Planes around voxels: normals (m, 3), distances (m,) of the voxels off them, classes (m,)."""

    normals: Floats
    off: Floats
    bins: Ints


def moved(voxels: Ints, table: Table) -> Floats:
    """Voxels (m, 3) with each moved along its normal, in voxels."""
    around = surroundings(voxels, table.block)
    shift = table.shares[around.bins] / _ONE * around.off
    return np.asarray(voxels - shift[:, None] * around.normals)


def best_table(voxels: Ints, means: Floats, weights: Floats) -> tuple[Table, float]:
    """The table that brings voxels (m, 3) nearest to the means (m, 3) of what they stand for.

    Also the weighted squared error that it saves.
    """
    best, most = Table(1, np.zeros(BINS, np.int8)), 0.0
    for block in BLOCKS:
        around = surroundings(voxels, block)
        wanted = np.einsum("ij,ij->i", voxels - means, around.normals)
        with_off = np.bincount(around.bins, weights * wanted * around.off, BINS)
        squared = np.bincount(around.bins, weights * around.off**2, BINS)
        shares = np.rint(_ONE * with_off / np.maximum(squared, 1e-12)).clip(-127, 127)
        gain = float((2 * shares / _ONE * with_off - (shares / _ONE) ** 2 * squared).sum())
        if gain > most:
            best, most = Table(block, shares.astype(np.int8)), gain
    return best, most


def surroundings(voxels: Ints, block: int) -> Surroundings:
    """Planes of least squares of the voxels around each voxel (m, 3)."""
    blocks = voxels // block
    blocks = blocks - blocks.min(axis=0) + 1
    keys = (blocks[:, 0] << 2 * _BITS) | (blocks[:, 1] << _BITS) | blocks[:, 2]
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1], [True]]))
    placed = voxels[order].astype(np.float64)
    found = np.empty((len(voxels), 5))
    _fit(placed, ordered[starts[:-1]], starts, found)
    back = np.empty_like(found)
    back[order] = found
    distance = np.searchsorted(_DISTANCES, np.abs(back[:, 3]))
    bins = distance * (len(_THICKNESSES) + 1) + np.searchsorted(_THICKNESSES, back[:, 4])
    return Surroundings(back[:, :3], back[:, 3], bins)


@compiled
def _fit(xyz: Floats, keys: Ints, starts: Ints, found: Floats) -> None:
    """Write normal, distance and thickness for each voxel; blocks are in the order of keys."""
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


@compiled
def _add(xyz: Floats, begin: int, end: int, middle: Floats, moments: Floats) -> None:
    for k in range(begin, end):
        x, y, z = xyz[k, 0] - middle[0], xyz[k, 1] - middle[1], xyz[k, 2] - middle[2]
        add_point(moments, x, y, z, 1.0)

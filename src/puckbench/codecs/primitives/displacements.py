"""Voxels moved along the normals of their surroundings, as far as the encoder found to be right.

A voxel on a wall is more often passed through on the side where the wall is: noise thins out away
from it, and a coarse voxel is cut by it off its middle. How far a voxel should move depends on how
far it is off the plane of the voxels around it and on how thick these lie; the encoder sends the
mean for each class of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.codecs.primitives.layout import Ints
from puckbench.codecs.primitives.stream import BINS, BLOCKS, Table
from puckbench.geometry.cloud import Floats
from puckbench.geometry.tangent_planes import tangents

_DISTANCES = np.array([0.25, 0.5, 0.75, 1.0, 1.5])
_THICKNESSES = np.array([0.3, 0.5, 0.9])
_ONE = 64


class _Surroundings(NamedTuple):
    """Planes around voxels: normals (m, 3), distances (m,) of the voxels off them, classes (m,)."""

    normals: Floats
    off: Floats
    bins: Ints


def moved(voxels: Ints, table: Table) -> Floats:
    """Voxels (m, 3) with each moved along its normal, in voxels."""
    around = _surroundings(voxels, table.block)
    shift = table.shares[around.bins] / _ONE * around.off
    return np.asarray(voxels - shift[:, None] * around.normals)


def best_table(voxels: Ints, means: Floats, weights: Floats) -> tuple[Table, float]:
    """The table that brings voxels (m, 3) nearest to the means (m, 3) of what they stand for.

    Also the weighted squared error that it saves.
    """
    best, most = Table(1, np.zeros(BINS, np.int8)), 0.0
    for block in BLOCKS:
        around = _surroundings(voxels, block)
        wanted = np.einsum("ij,ij->i", voxels - means, around.normals)
        with_off = np.bincount(around.bins, weights * wanted * around.off, BINS)
        squared = np.bincount(around.bins, weights * around.off**2, BINS)
        shares = np.rint(_ONE * with_off / np.maximum(squared, 1e-12)).clip(-127, 127)
        gain = float((2 * shares / _ONE * with_off - (shares / _ONE) ** 2 * squared).sum())
        if gain > most:
            best, most = Table(block, shares.astype(np.int8)), gain
    return best, most


def _surroundings(voxels: Ints, block: int) -> _Surroundings:
    """Planes of least squares of the voxels around each voxel (m, 3)."""
    found = tangents(voxels, block)
    distance = np.searchsorted(_DISTANCES, np.abs(found.off))
    bins = distance * (len(_THICKNESSES) + 1) + np.searchsorted(_THICKNESSES, found.thickness)
    return _Surroundings(found.normals, found.off, bins)

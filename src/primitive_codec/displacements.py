"""Displacement of voxels along the normals of local planes.

A voxel's local plane is fitted to the voxels around it. Most points of a voxel lie on the same side
of the voxel's centre as the plane. The encoder sends a displacement factor, the fraction of the
distance that minimises the squared error, for each class of distance and surface thickness.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.geometry.tangent_planes import fit_tangent_planes
from primitive_codec.octree_arrays import Ints
from primitive_codec.stream import BLOCK_SIZES, CLASSES, DisplacementTable

_DISTANCE_BOUNDS = np.array([0.25, 0.5, 0.75, 1.0, 1.5])
"""Class bounds of the distance from the plane, in voxels."""
_THICKNESS_BOUNDS = np.array([0.3, 0.5, 0.9])
"""Class bounds of the surface thickness, in voxels."""
FACTOR_ONE = 64
"""Factor that moves a voxel onto its local plane."""


class LocalPlanes(NamedTuple):
    """Local planes of voxels: normals (m, 3), signed distances (m,) in voxels, and classes (m,)."""

    normals: Floats
    distances: Floats
    classes: Ints

    def displace(
        self, points: Floats | Ints, factors: NDArray[np.int8], side: float = 1.0
    ) -> Floats:
        """Move points (m, 3) towards their planes by ``factors[class] / FACTOR_ONE * distance``.

        `side` is the side of a voxel.
        """
        displacement = factors[self.classes] / FACTOR_ONE * self.distances * side
        return np.asarray(points - displacement[:, None] * self.normals)

    def fit_factors(self, offsets: Floats, weights: Floats) -> tuple[NDArray[np.int8], float]:
        """Return the least-squares factors (CLASSES,), and the reduction of the squared error.

        `offsets` (m, 3) are voxels minus the means of their points.
        """
        residuals = (offsets * self.normals).sum(axis=1)
        products = np.bincount(self.classes, weights * residuals * self.distances, CLASSES)
        squares = np.bincount(self.classes, weights * self.distances**2, CLASSES)
        factors = np.rint(FACTOR_ONE * products / np.maximum(squares, 1e-12)).clip(-127, 127)
        shares = factors / FACTOR_ONE
        gain = float((2 * shares * products - shares**2 * squares).sum())
        return factors.astype(np.int8), gain


def displace(voxels: Ints, table: DisplacementTable) -> Floats:
    """Return the displaced centres (m, 3) of voxels (m, 3), in voxels."""
    return _local_planes(voxels, table.block_size).displace(voxels, table.factors)


class FittedTable(NamedTuple):
    """A table that displaces voxels along the normals of local planes.

    `gain` is the reduction of the squared error, `displaced` the voxels' centres (m, 3) afterwards.
    """

    table: DisplacementTable
    gain: float
    displaced: Floats


def fit_displacements(voxels: Ints, means: Floats, weights: Floats) -> FittedTable:
    """Fit the factors and the block size to the means of the voxels' points by least squares."""
    offsets = voxels - means

    def fit(block_size: int) -> tuple[float, DisplacementTable, LocalPlanes]:
        planes = _local_planes(voxels, block_size)
        factors, gain = planes.fit_factors(offsets, weights)
        return gain, DisplacementTable(block_size, factors), planes

    gain, table, planes = max(map(fit, BLOCK_SIZES), key=lambda fitted: fitted[0])
    return FittedTable(table, gain, planes.displace(voxels, table.factors))


def _local_planes(voxels: Ints, block_size: int) -> LocalPlanes:
    planes = fit_tangent_planes(voxels, block_size)
    distance_class = np.searchsorted(_DISTANCE_BOUNDS, np.abs(planes.distances))
    thickness_class = np.searchsorted(_THICKNESS_BOUNDS, planes.thickness)
    classes = distance_class * (len(_THICKNESS_BOUNDS) + 1) + thickness_class
    return LocalPlanes(planes.normals, planes.distances, classes)

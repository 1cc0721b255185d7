"""Normal displacement of voxels: each moves along the normal of the voxels around it.

Noise is less dense away from a wall, so a voxel that is off the plane of its neighbours is more
often occupied by points on the side of the wall; and a plane cuts coarse voxels off their centres.
How far to move depends on a voxel's distance from the local plane and on the thickness of the
voxels around; the encoder sends the optimal share of the distance for each class of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats
from puckbench.geometry.tangent_planes import fit_tangent_planes
from puckbench.primitives.octree_arrays import Ints
from puckbench.primitives.stream import BLOCK_SIZES, CLASSES, DisplacementTable

_DISTANCES = np.array([0.25, 0.5, 0.75, 1.0, 1.5])
_THICKNESSES = np.array([0.3, 0.5, 0.9])
ONE = 64
"""The whole distance, in units of a factor."""


class LocalPlanes(NamedTuple):
    """Planes beside voxels: normals (m, 3), the voxels' distances (m,), their classes (m,)."""

    normals: Floats
    distances: Floats
    classes: Ints

    def moved(self, points: Floats | Ints, factors: NDArray[np.int8], side: float = 1.0) -> Floats:
        """Points (m, 3) of the voxels, moved by the shares of their classes; side: of a voxel."""
        shift = factors[self.classes] / ONE * self.distances * side
        return np.asarray(points - shift[:, None] * self.normals)

    def fitted(self, apart: Floats, weights: Floats) -> tuple[NDArray[np.int8], float]:
        """Shares of least squared error from voxels that lie `apart` (m, 3) from their points.

        Returns
        -------
        factors, gain
            (CLASSES,) shares in units of 1 / `ONE`, and the weighted squared error that they save.
        """
        wanted = (apart * self.normals).sum(axis=1)
        products = np.bincount(self.classes, weights * wanted * self.distances, CLASSES)
        squares = np.bincount(self.classes, weights * self.distances**2, CLASSES)
        factors = np.rint(ONE * products / np.maximum(squares, 1e-12)).clip(-127, 127)
        gain = float((2 * factors / ONE * products - (factors / ONE) ** 2 * squares).sum())
        return factors.astype(np.int8), gain


def displace(voxels: Ints, table: DisplacementTable) -> Floats:
    """Displaced centres (m, 3) of voxels (m, 3), in voxels."""
    return _local_planes(voxels, table.block_size).moved(voxels, table.factors)


class FittedTable(NamedTuple):
    """A table, the weighted squared error that it saves, the voxels (m, 3) as it displaces them."""

    table: DisplacementTable
    gain: float
    displaced: Floats


def fit_displacements(voxels: Ints, means: Floats, weights: Floats) -> FittedTable:
    """The table of least squared error between displaced voxels and the points that they stand for.

    Parameters
    ----------
    voxels
        (m, 3) integer coordinates.
    means
        (m, 3) means of each voxel's points, in voxels.
    weights
        (m,) weights of the squared errors.
    """
    apart = voxels - means

    def fitted(block_size: int) -> tuple[float, DisplacementTable, LocalPlanes]:
        planes = _local_planes(voxels, block_size)
        factors, gain = planes.fitted(apart, weights)
        return gain, DisplacementTable(block_size, factors), planes

    gain, table, planes = max(map(fitted, BLOCK_SIZES), key=lambda found: found[0])
    return FittedTable(table, gain, planes.moved(voxels, table.factors))


def _local_planes(voxels: Ints, block_size: int) -> LocalPlanes:
    """Least-squares planes of the voxels around each voxel (m, 3)."""
    found = fit_tangent_planes(voxels, block_size)
    distance = np.searchsorted(_DISTANCES, np.abs(found.distances))
    thickness = np.searchsorted(_THICKNESSES, found.thickness)
    return LocalPlanes(
        found.normals, found.distances, distance * (len(_THICKNESSES) + 1) + thickness
    )

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pcc_networks.sparse.voxels import Keys, morton_keys, unique_keys
from pcc_networks.training.examples import CubeExamples, Voxels, random_symmetry
from pointkit.geometry.cloud import Floats


@dataclass(frozen=True)
class OctreeExamples(CubeExamples):
    """Training examples: random cubes of points (n, 3) on grids of random scales."""

    cube_size: int = 128
    batch_size: int = 2
    min_voxels: int = 500
    finest: float = 1.0  # scales of grids are drawn log-uniformly from `coarsest` to `finest`
    coarsest: float = 0.125
    upright: bool = False  # rotate cubes about the vertical axis only
    kind: ClassVar[str] = "octree training cubes"

    def _crop(self, points: Floats, rng: np.random.Generator) -> Keys | None:
        scale = self.finest * (self.coarsest / self.finest) ** rng.random()
        centre = points[rng.integers(len(points))]
        corner = centre * scale - rng.random(3) * self.cube_size
        voxels = _voxels(points, corner / scale, scale, self.cube_size)
        keys = unique_keys(morton_keys(random_symmetry(voxels, self.cube_size, rng, self.upright)))
        return keys if len(keys) >= self.min_voxels else None


def _voxels(points: Floats, corner: Floats, scale: float, size: int) -> Voxels:
    inside = np.ones(len(points), dtype=bool)
    for axis in range(3):
        column = points[:, axis]
        inside &= (column > corner[axis]) & (column < corner[axis] + size / scale)
    return np.floor((points[inside] - corner) * scale).astype(np.int64).clip(0, size - 1)

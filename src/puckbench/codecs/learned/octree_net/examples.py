"""Training examples: cubes of points cut at random, on grids of random steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from puckbench.codecs.learned.sparse.voxels import Keys, distinct, morton_keys
from puckbench.codecs.learned.training.examples import Examples as CutCubes
from puckbench.codecs.learned.training.examples import Voxels, turned
from puckbench.geometry.cloud import Floats


@dataclass(frozen=True)
class Examples(CutCubes):
    """Batches of cubes, each batch made from its number and the seed alone.

    clouds: points (n, 3). side: a power of two. finest, coarsest: scales of the grids, drawn evenly
    on a logarithmic axis. upright: turn cubes about the vertical axis alone.
    """

    side: int = 128
    cubes: int = 2
    fewest: int = 500
    finest: float = 1.0
    coarsest: float = 0.125
    upright: bool = False
    kind: ClassVar[str] = "octree training cubes"

    def _cut(self, points: Floats, rng: np.random.Generator) -> Keys | None:
        scale = self.finest * (self.coarsest / self.finest) ** rng.random()
        centre = points[rng.integers(len(points))]
        least = centre * scale - rng.random(3) * self.side
        voxels = _voxels(points, least / scale, scale, self.side)
        keys = distinct(morton_keys(turned(voxels, self.side, rng, self.upright)))
        return keys if len(keys) >= self.fewest else None


def _voxels(points: Floats, least: Floats, scale: float, side: int) -> Voxels:
    """The voxels of a cube of a cloud, one for each point."""
    inside = np.ones(len(points), dtype=bool)
    for axis in range(3):
        column = points[:, axis]
        inside &= (column > least[axis]) & (column < least[axis] + side / scale)
    return np.floor((points[inside] - least) * scale).astype(np.int64).clip(0, side - 1)

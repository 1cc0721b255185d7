"""Training examples: cubes of points cut at random, on grids of random steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.sparse.voxels import Keys, distinct, morton_keys
from puckbench.errors import InputError
from puckbench.seeding import generator

_TRIES = 50


@dataclass(frozen=True)
class Examples:
    """Batches of cubes, each batch made from its number and the seed alone.

    clouds: points (n, 3). side: of a cube, in voxels, a power of two. cubes: of a batch. finest,
    coarsest: scales of the grids, drawn evenly on a logarithmic axis. fewest: voxels of a cube
    worth learning from.
    """

    clouds: Sequence[Floats]
    side: int = 128
    cubes: int = 2
    finest: float = 1.0
    coarsest: float = 0.125
    fewest: int = 500
    seed: int = 1

    def batch(self, step: int) -> list[Keys]:
        """The cubes of a step, mirrored and turned at random; InputError when none has enough."""
        rng = generator(self.seed, "octree training cubes", str(step))
        return [self._cube(rng) for _ in range(self.cubes)]

    def _cube(self, rng: np.random.Generator) -> Keys:
        for _ in range(_TRIES):
            points = self.clouds[int(rng.integers(len(self.clouds)))]
            scale = self.finest * (self.coarsest / self.finest) ** rng.random()
            centre = points[rng.integers(len(points))]
            least = centre * scale - rng.random(3) * self.side
            keys = _voxels(points, least / scale, scale, self.side, rng)
            if len(keys) >= self.fewest:
                return keys
        raise InputError(f"no cube of {self.side} voxels' side holds {self.fewest} voxels")


def _voxels(
    points: Floats, least: Floats, scale: float, side: int, rng: np.random.Generator
) -> Keys:
    """The voxels of a cube of a cloud, in one of the 48 symmetries of a cube."""
    inside = np.ones(len(points), dtype=bool)
    for axis in range(3):
        column = points[:, axis]
        inside &= (column > least[axis]) & (column < least[axis] + side / scale)
    voxels = np.floor((points[inside] - least) * scale).astype(np.int64).clip(0, side - 1)
    mirrored = np.where(rng.integers(0, 2, 3) == 1, side - 1 - voxels, voxels)
    return distinct(morton_keys(mirrored[:, rng.permutation(3)]))

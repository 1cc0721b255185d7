"""Training examples: cubes cut at random from clouds on the integer grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.sparse.voxels import Keys, morton_keys
from puckbench.errors import InputError
from puckbench.seeding import generator

_TRIES = 50


@dataclass(frozen=True)
class Examples:
    """Batches of cubes, each batch made from its number and the seed alone.

    clouds: voxels (n, 3). side: of a cube, in voxels. fewest: voxels of a cube worth learning from.
    thinnest: the least share of its voxels that a cube keeps; the share is drawn anew for each cube,
    evenly on a logarithmic axis, so that clouds of other densities are met.
    """

    clouds: Sequence[NDArray[np.integer[Any]]]
    side: int = 64
    cubes: int = 4
    fewest: int = 200
    thinnest: float = 1.0
    seed: int = 1

    def batch(self, step: int) -> list[Keys]:
        """The cubes of a step, mirrored and turned at random; InputError when none has enough."""
        rng = generator(self.seed, "training cubes", str(step))
        return [self._cube(rng) for _ in range(self.cubes)]

    def _cube(self, rng: np.random.Generator) -> Keys:
        for _ in range(_TRIES):
            voxels = self.clouds[int(rng.integers(len(self.clouds)))]
            centre = voxels[rng.integers(len(voxels))]
            least = centre - rng.integers(0, self.side, 3)
            inside = voxels[((voxels >= least) & (voxels < least + self.side)).all(axis=1)] - least
            inside = inside[rng.random(len(inside)) < self.thinnest ** rng.random()]
            if len(inside) >= self.fewest:
                return np.unique(morton_keys(_turned(inside, self.side, rng)))
        raise InputError(f"no cube of {self.side} voxels' side holds {self.fewest} voxels")


def _turned(
    voxels: NDArray[np.integer[Any]], side: int, rng: np.random.Generator
) -> NDArray[np.integer[Any]]:
    """One of the 48 symmetries of a cube."""
    mirrored = np.where(rng.integers(0, 2, 3) == 1, side - 1 - voxels, voxels)
    return mirrored[:, rng.permutation(3)]

"""Training examples: cubes cut at random from clouds on the integer grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.sparse.voxels import Keys, morton_keys
from puckbench.core.errors import InputError
from puckbench.core.seeding import generator

_TRIES = 50
Voxels = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Examples:
    """Batches of cubes, each batch made from its number and the seed alone.

    clouds: voxels (n, 3). side: of a cube, in voxels. fewest: voxels of a cube worth learning from.
    thinnest: the least share of its voxels that a cube keeps; the share is drawn anew for each
    cube, evenly on a logarithmic axis, so that clouds of other densities are met.
    """

    clouds: Sequence[NDArray[Any]]
    side: int = 64
    cubes: int = 4
    fewest: int = 200
    thinnest: float = 1.0
    seed: int = 1
    kind: ClassVar[str] = "training cubes"

    def batch(self, step: int) -> list[Keys]:
        """The cubes of a step, mirrored and turned at random; InputError when none has enough."""
        rng = generator(self.seed, self.kind, str(step))
        return [self._cube(rng) for _ in range(self.cubes)]

    def _cube(self, rng: np.random.Generator) -> Keys:
        for _ in range(_TRIES):
            keys = self._cut(self.clouds[int(rng.integers(len(self.clouds)))], rng)
            if keys is not None:
                return keys
        raise InputError(f"no cube of {self.side} voxels' side holds {self.fewest} voxels")

    def _cut(self, voxels: NDArray[Any], rng: np.random.Generator) -> Keys | None:
        """A cube somewhere in a cloud; None where it has too few voxels."""
        centre = voxels[rng.integers(len(voxels))]
        least = centre - rng.integers(0, self.side, 3)
        inside = voxels[((voxels >= least) & (voxels < least + self.side)).all(axis=1)] - least
        inside = inside[rng.random(len(inside)) < self.thinnest ** rng.random()]
        if len(inside) < self.fewest:
            return None
        return np.unique(morton_keys(turned(inside, self.side, rng)))


def turned(voxels: Voxels, side: int, rng: np.random.Generator, upright: bool = False) -> Voxels:
    """Voxels of a cube in one of its 48 symmetries, or of the 8 that leave the z axis alone."""
    axes = 2 if upright else 3
    found = voxels.copy()
    mirrored = np.where(
        rng.integers(0, 2, axes) == 1, side - 1 - voxels[:, :axes], voxels[:, :axes]
    )
    found[:, :axes] = mirrored[:, rng.permutation(axes)]
    return found


def batch(clouds: Sequence[Keys]) -> Keys:
    """Clouds of voxels as one set in which none touches another."""
    bits = max(int(keys[-1]).bit_length() for keys in clouds)
    cell = 3 * (-(-bits // 3) + 1)  # twice the side, so that there is a gap
    if cell + (len(clouds) - 1).bit_length() > 60:
        raise InputError("the training clouds are too large for one batch")
    return np.concatenate([keys | i << cell for i, keys in enumerate(clouds)])

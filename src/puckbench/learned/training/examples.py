"""Training examples: cubes cut at random from clouds on the integer grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.learned.sparse.voxels import Keys, morton_keys

_TRIES = 50
Voxels = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class CubeExamples:
    """Batches of cubes; a batch depends on its number and the seed alone.

    Parameters
    ----------
    clouds
        Voxels (n, 3).
    cube_size
        Voxels along an edge of a cube.
    batch_size
        Cubes of a batch.
    min_voxels
        Voxels of a cube worth learning from.
    min_kept_fraction
        Smallest fraction of its voxels that a cube keeps; it is drawn anew for each cube, evenly on
        a logarithmic axis, so that sparser clouds are learned from too.
    seed
        Of the random numbers.
    """

    clouds: Sequence[NDArray[Any]]
    cube_size: int = 64
    batch_size: int = 4
    min_voxels: int = 200
    min_kept_fraction: float = 1.0
    seed: int = 1
    kind: ClassVar[str] = "training cubes"
    """Names the stream of random numbers."""

    def batch(self, step: int) -> list[Keys]:
        """The cubes of a step in random symmetries; InputError when none has enough voxels."""
        rng = generator(self.seed, self.kind, str(step))
        return [self._cube(rng) for _ in range(self.batch_size)]

    def _cube(self, rng: np.random.Generator) -> Keys:
        for _ in range(_TRIES):
            keys = self._crop(self.clouds[int(rng.integers(len(self.clouds)))], rng)
            if keys is not None:
                return keys
        raise InputError(
            f"no cube of {self.cube_size} voxels' side holds {self.min_voxels} voxels: give denser "
            "clouds, scale those in metres (puckbench prepare), or give options with coarser grids "
            '("mean_occupied_children": [2], where the codec has it) or larger cubes '
            '("cube_size": 256)'
        )

    def _crop(self, voxels: NDArray[Any], rng: np.random.Generator) -> Keys | None:
        """A cube somewhere in a cloud; None where it has too few voxels."""
        size = self.cube_size
        centre = voxels[rng.integers(len(voxels))]
        least = centre - rng.integers(0, size, 3)
        inside = voxels[((voxels >= least) & (voxels < least + size)).all(axis=1)] - least
        inside = inside[rng.random(len(inside)) < self.min_kept_fraction ** rng.random()]
        if len(inside) < self.min_voxels:
            return None
        return np.unique(morton_keys(random_symmetry(inside, size, rng)))


def random_symmetry(
    voxels: Voxels, size: int, rng: np.random.Generator, upright: bool = False
) -> Voxels:
    """Voxels (n, 3) of a cube in one of its 48 symmetries, or of the 8 that keep the z axis."""
    axes = 2 if upright else 3
    found = voxels.copy()
    mirrored = np.where(
        rng.integers(0, 2, axes) == 1, size - 1 - voxels[:, :axes], voxels[:, :axes]
    )
    found[:, :axes] = mirrored[:, rng.permutation(axes)]
    return found


def batch(clouds: Sequence[Keys]) -> Keys:
    """Clouds of voxels, by their keys, as one set in which none touches another."""
    bits = max(int(keys[-1]).bit_length() for keys in clouds)
    cell = 3 * (-(-bits // 3) + 1)  # twice the side, so that there is a gap
    if cell + (len(clouds) - 1).bit_length() > 60:
        raise InputError("the training clouds are too large for one batch")
    return np.concatenate([keys | i << cell for i, keys in enumerate(clouds)])

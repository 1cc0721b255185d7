from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pcc_networks.sparse.voxels import Keys, morton_keys
from pointkit.errors import InputError
from pointkit.seeding import generator

_ATTEMPTS = 50
Voxels = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class CubeExamples:
    """Random cubes cut from clouds on the integer grid; step and seed determine a batch."""

    clouds: Sequence[NDArray[Any]]  # voxels (n, 3)
    cube_size: int = 64  # voxels along an edge
    batch_size: int = 4  # cubes of a batch
    min_voxels: int = 200  # of a cube
    # each cube keeps a log-uniformly drawn fraction of its voxels, so that training includes
    # sparser clouds
    min_kept_fraction: float = 1.0
    seed: int = 1
    kind: ClassVar[str] = "training cubes"  # name of the stream of random numbers

    def batch(self, step: int) -> list[Keys]:
        """Return a step's cubes, in random symmetries, as keys.

        Raises InputError if no cube has enough voxels.
        """
        rng = generator(self.seed, self.kind, str(step))
        return [self._cube(rng) for _ in range(self.batch_size)]

    def _cube(self, rng: np.random.Generator) -> Keys:
        for _ in range(_ATTEMPTS):
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
        size = self.cube_size
        centre = voxels[rng.integers(len(voxels))]
        corner = centre - rng.integers(0, size, 3)
        inside = voxels[((voxels >= corner) & (voxels < corner + size)).all(axis=1)] - corner
        inside = inside[rng.random(len(inside)) < self.min_kept_fraction ** rng.random()]
        if len(inside) < self.min_voxels:
            return None
        return np.unique(morton_keys(random_symmetry(inside, size, rng)))


def random_symmetry(
    voxels: Voxels, size: int, rng: np.random.Generator, upright: bool = False
) -> Voxels:
    """Apply a random symmetry of a cube to voxels: one of 48, or of the 8 that keep the z axis."""
    axes = 2 if upright else 3
    symmetric = voxels.copy()
    mirrored = np.where(
        rng.integers(0, 2, axes) == 1, size - 1 - voxels[:, :axes], voxels[:, :axes]
    )
    symmetric[:, :axes] = mirrored[:, rng.permutation(axes)]
    return symmetric


def join_clouds(clouds: Sequence[Keys]) -> Keys:
    """Join the Morton keys of clouds so that no two clouds touch."""
    bits = max(int(keys[-1]).bit_length() for keys in clouds)
    cell = 3 * (-(-bits // 3) + 1)  # twice the side, which leaves a gap
    if cell + (len(clouds) - 1).bit_length() > 60:
        raise InputError("the training clouds are too large for one batch")
    return np.concatenate([keys | i << cell for i, keys in enumerate(clouds)])

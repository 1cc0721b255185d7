"""Training of the sparse octree net: examples, loss, and optimiser step.

The loss is the number of bits of the symbols. Training uses the fixed-point arithmetic of the
codec; therefore nothing changes when weights are later rounded to integers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from pcc_networks.octree_net.model import (
    MAX_ACTIVATION,
    MAX_SUM,
    WEIGHT_UNITS,
    FixedPointLayer,
    OctreeNet,
    as_index,
)
from pcc_networks.octree_net.symbols import Symbols, groups_of, symbols_of
from pcc_networks.sparse.convolution import Neighbourhood, neighbourhood_of
from pcc_networks.sparse.gather_scatter import voxel_kernel_map
from pcc_networks.sparse.thread_pool import ThreadPool
from pcc_networks.sparse.voxels import Keys, morton_keys, pyramid, unique_keys
from pcc_networks.training.loop import (
    BaseTrainer,
    CubeExamples,
    Voxels,
    join_clouds,
    random_symmetry,
)
from pcc_networks.training.settings import BaseTraining
from pointkit.geometry.cloud import Floats


@dataclass(frozen=True)
class OctreeExamples(CubeExamples):
    """Random cubes that are cut from clouds of points (n, 3), on grids of random scales."""

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


_MAX_ROW = 0.9 * MAX_SUM / (MAX_ACTIVATION * WEIGHT_UNITS)
"""Maximum sum of an output feature's absolute weights that keeps the feature's sums exact."""


def bits_per_level(model: OctreeNet, keys: Keys, levels: int, pool: ThreadPool) -> list[Tensor]:
    """Return the bits that the network needs for a cloud.

    Parameters
    ----------
    model
        The network.
    keys
        Morton keys (n,) of the voxels of the finest level.
    levels
        Number of coarser levels.
    pool
        Threads of the convolutions.

    Returns
    -------
    list of Tensor
        Bits of the symbols of each coarser level, the coarsest first.
    """
    device = model.root.device
    sets, child_maps = pyramid(keys, levels, pool)
    features = model.root_features(len(sets[-1]))
    bits = []
    for depth in range(levels, 0, -1):
        neighbourhood = neighbourhood_of(sets[depth].neighbours, voxel_kernel_map(), pool, device)
        features = model.convolved(features, neighbourhood)
        symbols = symbols_of(sets[depth - 1].keys)
        level_bits, features = _bits_of_level(
            model, features, sets[depth].keys, symbols, neighbourhood
        )
        bits.append(level_bits)
        if depth > 1:
            slots = torch.from_numpy(child_maps[depth - 1].slots).to(device)
            features = model.child_features(features, slots)
    return bits


def _bits_of_level(
    model: OctreeNet,
    features: Tensor,
    keys: Keys,
    symbols: tuple[Symbols, Symbols],
    neighbourhood: Neighbourhood,
) -> tuple[Tensor, Tensor]:
    bits = []
    for group, rows in enumerate(groups_of(keys)):
        if len(rows):
            index = as_index(rows, features)
            selected = model.group_features(group, features, index, neighbourhood)
            first, second = (as_index(symbol[rows], features) for symbol in symbols)
            bits.append(_bits(model.first_heads[group](selected), first))
            selected = model.with_first(selected, first)
            bits.append(_bits(model.second_heads[group](selected), second))
            features = features.index_copy(0, index, model.with_second(selected, second))
    return torch.stack(bits).sum(), features


def _bits(logits: Tensor, symbols: Tensor) -> Tensor:
    nats = cross_entropy(logits * math.log(2), symbols, reduction="sum")
    return nats / math.log(2)


class OctreeNetTrainer(BaseTrainer[OctreeNet, float]):
    """Trains a sparse octree net; the loss of a step is in bits per voxel."""

    max_gradient_norm = 1.0

    def __init__(self, model: OctreeNet, training: BaseTraining, pool: ThreadPool) -> None:
        super().__init__(model, training)
        self.levels = (training.cube_size - 1).bit_length()
        self.pool = pool

    def step(self, clouds: Sequence[Keys]) -> float:
        """Do one step of the optimiser on a batch, and return the loss in bits per voxel."""
        keys = join_clouds(clouds)
        bits = torch.stack(bits_per_level(self.model, keys, self.levels, self.pool))
        loss = bits.sum() / len(keys)
        self.optimiser_step(loss)
        limit_weights(self.model)
        return float(loss.detach())

    def row(self, loss: float) -> dict[str, float]:
        """Return the loss of a step as a row of the training curve."""
        return {"bits_per_voxel": loss}


def limit_weights(model: OctreeNet) -> None:
    """Scale down the weights of output features whose sums might otherwise become inexact."""
    with torch.no_grad():
        for layer in model.modules():
            if isinstance(layer, FixedPointLayer):
                rows = layer.kernel.abs().sum(dim=(0, 1))
                layer.kernel.mul_((_MAX_ROW / rows).clamp_max(1))

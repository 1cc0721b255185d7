"""Training of the learned octree coder: bits of a batch's symbols as the loss, and one step.

The network computes in fixed point while it is trained too, bit for bit as the codec will (rounding
passes gradients unchanged), so that nothing is lost when its weights become integers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from puckbench.learned.octree_net.fixed_point import MAX_ACTIVATION, MAX_SUM, WEIGHT_UNITS
from puckbench.learned.octree_net.model import FixedPointLayer, OctreeNet, as_index
from puckbench.learned.octree_net.symbols import Symbols, groups_of, symbols_of
from puckbench.learned.sparse.convolution import Neighbourhood, neighbourhood_of
from puckbench.learned.sparse.kernel_map import voxel_kernel_map
from puckbench.learned.sparse.thread_pool import ThreadPool
from puckbench.learned.sparse.voxels import Keys, pyramid
from puckbench.learned.training.examples import batch
from puckbench.learned.training.loop import BaseTrainer
from puckbench.learned.training.settings import BaseTraining

_MAX_ROW = 0.9 * MAX_SUM / (MAX_ACTIVATION * WEIGHT_UNITS)
"""Sum of a layer's weights onto one feature, at most: sums stay exact, with a margin."""


def bits_per_level(model: OctreeNet, keys: Keys, levels: int, pool: ThreadPool) -> list[Tensor]:
    """Bits of all symbols of each of the `levels` above voxels in Morton order, coarsest first."""
    device = model.root.device
    sets, child_maps = pyramid(keys, levels, pool)
    features = model.root_features(len(sets[-1]))
    bits = []
    for depth in range(levels, 0, -1):
        neighbourhood = neighbourhood_of(sets[depth].neighbours, voxel_kernel_map(), pool, device)
        features = model.convolved(features, neighbourhood)
        symbols = symbols_of(sets[depth - 1].keys)
        of_level, features = _bits_of_level(
            model, features, sets[depth].keys, symbols, neighbourhood
        )
        bits.append(of_level)
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
    """Bits of a level's symbols, and features with the embeddings of these symbols."""
    bits = []
    for group, rows in enumerate(groups_of(keys)):
        if len(rows):
            index = as_index(rows, features)
            own = model.group_features(group, features, index, neighbourhood)
            first, second = (as_index(symbol[rows], features) for symbol in symbols)
            bits.append(_bits(model.first_heads[group](own), first))
            own = model.with_first(own, first)
            bits.append(_bits(model.second_heads[group](own), second))
            features = features.index_copy(0, index, model.with_second(own, second))
    return torch.stack(bits).sum(), features


def _bits(logits: Tensor, symbols: Tensor) -> Tensor:
    """Bits of symbols (n,) by logits (n, 16) to the base 2."""
    nats = cross_entropy(logits * math.log(2), symbols, reduction="sum")
    return nats / math.log(2)


class OctreeNetTrainer(BaseTrainer[OctreeNet, float]):
    """The learned octree coder in training."""

    max_gradient_norm = 1.0

    def __init__(self, model: OctreeNet, training: BaseTraining, pool: ThreadPool) -> None:
        super().__init__(model, training)
        self.pool = pool

    def step(self, clouds: Sequence[Keys]) -> float:
        """One step on a batch of cubes; returns bits per voxel."""
        keys = batch(clouds)
        levels = (self.training.cube_size - 1).bit_length()
        loss = torch.stack(bits_per_level(self.model, keys, levels, self.pool)).sum() / len(keys)
        self.optimiser_step(loss)
        limit_weights(self.model)
        return float(loss.detach())

    def row(self, loss: float) -> dict[str, float]:
        """Bits per voxel."""
        return {"bits_per_voxel": loss}


def limit_weights(model: OctreeNet) -> None:
    """Shrink the weights onto each feature whose sums might cease to be exact."""
    with torch.no_grad():
        for layer in model.modules():
            if isinstance(layer, FixedPointLayer):
                rows = layer.kernel.abs().sum(dim=(0, 1))
                layer.kernel.mul_((_MAX_ROW / rows).clamp_max(1))

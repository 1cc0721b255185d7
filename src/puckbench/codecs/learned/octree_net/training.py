"""Training: bits of a batch's symbols as the loss, and one step.

The network computes in fixed point while it is trained too, bit for bit as the codec will (rounding
passes gradients unchanged), so that nothing is lost when its weights become whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from puckbench.codecs.learned.octree_net.fixed_point import MOST_ACTIVATION, MOST_SUM, WEIGHT_UNITS
from puckbench.codecs.learned.octree_net.model import Layer, OctreeNet, index
from puckbench.codecs.learned.octree_net.symbols import Symbols, groups_of, symbols_of
from puckbench.codecs.learned.sparse.convolution import Site, site
from puckbench.codecs.learned.sparse.kernel_map import rows_layout
from puckbench.codecs.learned.sparse.thread_pool import Crew
from puckbench.codecs.learned.sparse.voxels import Keys, pyramid
from puckbench.codecs.learned.training.examples import batch
from puckbench.codecs.learned.training.loop import Trainer as AnyTrainer
from puckbench.codecs.learned.training.settings import Training

_LARGEST_ROW = 0.9 * MOST_SUM / (MOST_ACTIVATION * WEIGHT_UNITS)
"""Sum of a layer's weights onto one feature, at most: exact sums, and something to spare."""


def bits_per_level(model: OctreeNet, keys: Keys, levels: int, crew: Crew) -> list[Tensor]:
    """Bits of all symbols of each of the `levels` above voxels in Morton order, coarse first."""
    device = model.top.device
    sets, families = pyramid(keys, levels, crew)
    features = model.start(len(sets[-1]))
    bits = []
    for depth in range(levels, 0, -1):
        where = site(sets[depth].neighbours, rows_layout(), crew, device)
        features = model.before_groups(features, where)
        symbols = symbols_of(sets[depth - 1].keys)
        of_level, features = _bits_of_level(model, features, sets[depth].keys, symbols, where)
        bits.append(of_level)
        if depth > 1:
            slots = torch.from_numpy(families[depth - 1].slots).to(device)
            features = model.below(features, slots)
    return bits


def _bits_of_level(
    model: OctreeNet, features: Tensor, keys: Keys, symbols: tuple[Symbols, Symbols], where: Site
) -> tuple[Tensor, Tensor]:
    """Bits of a level's symbols, and features that know them."""
    bits = []
    for group, rows in enumerate(groups_of(keys)):
        if len(rows):
            at = index(rows, features)
            own = model.of_group(group, features, at, where)
            first, second = (index(symbol[rows], features) for symbol in symbols)
            bits.append(_bits(model.first_heads[group](own), first))
            own = model.with_first(own, first)
            bits.append(_bits(model.second_heads[group](own), second))
            features = features.index_copy(0, at, model.with_second(own, second))
    return torch.stack(bits).sum(), features


def _bits(logits: Tensor, symbols: Tensor) -> Tensor:
    """Bits of symbols (n,) by logits (n, 16) to the base 2."""
    nats = cross_entropy(logits * math.log(2), symbols, reduction="sum")
    return nats / math.log(2)


class Trainer(AnyTrainer[OctreeNet, float]):
    """A network in training."""

    steepest = 1.0

    def __init__(self, model: OctreeNet, training: Training, crew: Crew) -> None:
        super().__init__(model, training)
        self.crew = crew

    def step(self, clouds: Sequence[Keys]) -> float:
        """One step on a batch of cubes; bits per voxel."""
        keys = batch(clouds)
        levels = (self.training.side - 1).bit_length()
        loss = torch.stack(bits_per_level(self.model, keys, levels, self.crew)).sum() / len(keys)
        self.descend(loss)
        limit(self.model)
        return float(loss.detach())

    def row(self, loss: float) -> dict[str, float]:
        """Bits per voxel."""
        return {"bits_per_voxel": loss}


def limit(model: OctreeNet) -> None:
    """Shrink the weights onto a feature where their sums might cease to be exact."""
    with torch.no_grad():
        for layer in model.modules():
            if isinstance(layer, Layer):
                rows = layer.kernel.abs().sum(dim=(0, 1))
                layer.kernel.mul_((_LARGEST_ROW / rows).clamp_max(1))

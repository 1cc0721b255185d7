"""Training PCGCv2: its loss, and one step.

The loss of a cloud at a rate is ``alpha * sum over 3 scales of the mean binary cross entropy, in
bits, of its candidate voxels + bits of the latent per point``, divided by the square root of alpha
so that no rate outweighs the others where they share weights. The authors add the scales up as they
are; here they weigh as the sides of their voxels, since a voxel missed at stride 4 cannot be mended
at stride 1. While training, rounding is uniform
noise and the true voxels are kept at each scale beside those that the network chose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from puckbench.codecs.learned.gains import parameter_groups
from puckbench.codecs.learned.pcgcv2.model import SCALES, PCGCv2
from puckbench.codecs.learned.sparse.convolution import site
from puckbench.codecs.learned.sparse.kernel_map import blocks_layout, rows_layout
from puckbench.codecs.learned.sparse.layers import kept_children
from puckbench.codecs.learned.sparse.thread_pool import Crew
from puckbench.codecs.learned.sparse.voxels import (
    CHILDREN,
    Keys,
    Voxels,
    descended,
    keys_of_slots,
    pyramid,
)
from puckbench.codecs.learned.training.examples import batch
from puckbench.codecs.learned.training.loop import Trainer as AnyTrainer
from puckbench.codecs.learned.training.settings import TrainingByAlpha

WEIGHTS = tuple(SCALES * side / 7 for side in (4.0, 2.0, 1.0))
"""Of the scales in the loss; together as much as the authors'."""


class Loss(NamedTuple):
    """What a batch costs.

    entropies: mean bits of a candidate at strides 4, 2 and 1. bpp: bits of the latent per point.
    """

    total: Tensor
    entropies: tuple[Tensor, ...]
    bpp: Tensor


def loss_of(
    model: PCGCv2, keys: Keys, rate: int, alpha: float, crew: Crew, noise: torch.Generator
) -> Loss:
    """The loss of voxels in Morton order at a rate."""
    device = model.log_gains.device
    sets, families = pyramid(keys, SCALES, crew)
    sites = [site(voxels.neighbours, rows_layout(), crew, device) for voxels in sets]
    latent = model.encoder(sites, families, torch.ones(len(keys), 1, 1, device=device))[:, 0]
    scaled = latent * model.gain(rate)
    noisy = scaled + torch.rand(scaled.shape, generator=noise).to(device) - 0.5
    bits = -model.bottleneck(rate).likelihood(noisy).log2().sum()
    entropies = _entropies(model, noisy / model.gain(rate), sets, crew)
    bpp = bits / len(keys)
    entropy = torch.stack(entropies) @ torch.tensor(WEIGHTS, device=device)
    total = (alpha * entropy + bpp) / math.sqrt(alpha)
    return Loss(total, tuple(entropies), bpp)


def _entropies(model: PCGCv2, features: Tensor, sets: list[Voxels], crew: Crew) -> list[Tensor]:
    entropies, parents = [], sets[SCALES]
    for scale in range(SCALES):
        where = site(parents.neighbours, blocks_layout(), crew, features.device)
        children, logits = model.decoder.scale(scale)(features, where)
        truth = sets[SCALES - 1 - scale].keys
        occupied = _occupied(parents, truth)
        target = torch.from_numpy(occupied).to(logits)
        entropies.append(binary_cross_entropy_with_logits(logits.reshape(-1), target) / math.log(2))
        if scale + 1 < SCALES:
            chosen = kept_children(logits.detach().cpu().numpy(), len(truth))
            kept = np.union1d(chosen, np.flatnonzero(occupied))
            features = children.flatten(0, 1)[torch.from_numpy(kept).to(features.device)]
            parents = descended(parents, kept, crew)
    return entropies


def _occupied(parents: Voxels, truth: Keys) -> NDArray[np.bool_]:
    """Which of all children of the parents are in a set of keys, ascending."""
    candidates = keys_of_slots(parents.keys, np.arange(CHILDREN * len(parents)))
    nearest = np.minimum(np.searchsorted(truth, candidates), len(truth) - 1)
    occupied: NDArray[np.bool_] = truth[nearest] == candidates
    return occupied


class Trainer(AnyTrainer[PCGCv2, Loss]):
    """PCGCv2 in training, at all its rates in turn."""

    training: TrainingByAlpha

    def __init__(self, model: PCGCv2, training: TrainingByAlpha, crew: Crew) -> None:
        super().__init__(model, training, parameter_groups(model))
        self.crew = crew

    def step(self, clouds: Sequence[Keys]) -> Loss:
        """One step on a batch, at the rate whose turn it is."""
        rate = int(torch.randint(len(self.training.alphas), (1,), generator=self.noise))
        alpha = self.training.alphas[rate]
        loss = loss_of(self.model, batch(clouds), rate, alpha, self.crew, self.noise)
        self.descend(loss.total)
        return Loss(
            loss.total.detach(), tuple(e.detach() for e in loss.entropies), loss.bpp.detach()
        )

    def row(self, loss: Loss) -> dict[str, float]:
        """Loss, bits of a candidate at each stride, bits of the latent per point."""
        names = ("loss", "bits_stride_4", "bits_stride_2", "bits_stride_1", "bpp")
        values = (loss.total, *loss.entropies, loss.bpp)
        return {name: float(value) for name, value in zip(names, values, strict=True)}

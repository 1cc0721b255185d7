"""Training of PCGCv2: its rate-distortion loss, and one step.

The loss of a batch at a rate is ``lambda * D + R``, divided by the square root of lambda so that no
rate outweighs the others where they share weights. R is the bits of the latent per point. D is the
mean binary cross entropy, in bits, of the candidate voxels of each scale, weighted by the side of
the voxels, since a voxel missed at stride 4 cannot be recovered at stride 1 (the authors weigh all
scales alike). Rounding is replaced by uniform noise, and the true voxels of each scale are kept
beside those that the network chooses.
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

from puckbench.learned.gains import parameter_groups
from puckbench.learned.pcgcv2.model import SCALES, PCGCv2
from puckbench.learned.sparse.convolution import neighbourhood
from puckbench.learned.sparse.kernel_map import block_kernel_map, voxel_kernel_map
from puckbench.learned.sparse.layers import kept_children
from puckbench.learned.sparse.thread_pool import ThreadPool
from puckbench.learned.sparse.voxels import (
    CHILDREN,
    Keys,
    VoxelSet,
    keys_of_slots,
    pyramid,
    selected_children,
)
from puckbench.learned.training.examples import batch
from puckbench.learned.training.loop import BaseTrainer
from puckbench.learned.training.settings import MultiRateTraining

SCALE_WEIGHTS = tuple(SCALES * side / 7 for side in (4.0, 2.0, 1.0))
"""Of strides 4, 2 and 1 in the loss; their sum is the authors'."""


class Pcgcv2Loss(NamedTuple):
    """The loss of a batch.

    Parameters
    ----------
    total
        What is minimised.
    cross_entropies
        Mean bits of a candidate voxel at strides 4, 2 and 1.
    bpp
        Bits of the latent per point.
    """

    total: Tensor
    cross_entropies: tuple[Tensor, ...]
    bpp: Tensor


def rate_distortion_loss(
    model: PCGCv2, keys: Keys, rate: int, lmbda: float, pool: ThreadPool, noise: torch.Generator
) -> Pcgcv2Loss:
    """The loss at a rate of voxels in Morton order (n,)."""
    device = model.log_gains.device
    sets, child_maps = pyramid(keys, SCALES, pool)
    sites = [neighbourhood(v.neighbours, voxel_kernel_map(), pool, device) for v in sets]
    y = model.g_a(sites, child_maps, torch.ones(len(keys), 1, 1, device=device))[:, 0]
    scaled = y * model.gain(rate)
    noisy = scaled + torch.rand(scaled.shape, generator=noise).to(device) - 0.5
    bits = -model.entropy_bottleneck(rate).likelihood(noisy).log2().sum()
    cross_entropies = _cross_entropies(model, noisy / model.gain(rate), sets, pool)
    bpp = bits / len(keys)
    distortion = torch.stack(cross_entropies) @ torch.tensor(SCALE_WEIGHTS, device=device)
    total = (lmbda * distortion + bpp) / math.sqrt(lmbda)
    return Pcgcv2Loss(total, tuple(cross_entropies), bpp)


def _cross_entropies(
    model: PCGCv2, features: Tensor, sets: list[VoxelSet], pool: ThreadPool
) -> list[Tensor]:
    found, parents = [], sets[SCALES]
    for scale in range(SCALES):
        where = neighbourhood(parents.neighbours, block_kernel_map(), pool, features.device)
        children, logits = model.g_s.scale(scale)(features, where)
        truth = sets[SCALES - 1 - scale].keys
        occupied = _occupied(parents, truth)
        target = torch.from_numpy(occupied).to(logits)
        found.append(binary_cross_entropy_with_logits(logits.reshape(-1), target) / math.log(2))
        if scale + 1 < SCALES:
            chosen = kept_children(logits.detach().cpu().numpy(), len(truth))
            kept = np.union1d(chosen, np.flatnonzero(occupied))
            features = children.flatten(0, 1)[torch.from_numpy(kept).to(features.device)]
            parents = selected_children(parents, kept, pool)
    return found


def _occupied(parents: VoxelSet, truth: Keys) -> NDArray[np.bool_]:
    """Which of all children of the parents are in a set of keys, ascending."""
    candidates = keys_of_slots(parents.keys, np.arange(CHILDREN * len(parents)))
    nearest = np.minimum(np.searchsorted(truth, candidates), len(truth) - 1)
    occupied: NDArray[np.bool_] = truth[nearest] == candidates
    return occupied


class Pcgcv2Trainer(BaseTrainer[PCGCv2, Pcgcv2Loss]):
    """PCGCv2 in training, each step at a rate drawn at random."""

    training: MultiRateTraining

    def __init__(self, model: PCGCv2, training: MultiRateTraining, pool: ThreadPool) -> None:
        super().__init__(model, training, parameter_groups(model))
        self.pool = pool

    def step(self, clouds: Sequence[Keys]) -> Pcgcv2Loss:
        """One step on a batch of cubes."""
        rate = int(torch.randint(len(self.training.lmbdas), (1,), generator=self.noise))
        lmbda = self.training.lmbdas[rate]
        keys = batch(clouds)
        loss = rate_distortion_loss(self.model, keys, rate, lmbda, self.pool, self.noise)
        self.optimiser_step(loss.total)
        cross_entropies = tuple(value.detach() for value in loss.cross_entropies)
        return Pcgcv2Loss(loss.total.detach(), cross_entropies, loss.bpp.detach())

    def row(self, loss: Pcgcv2Loss) -> dict[str, float]:
        """Loss, bits of a candidate voxel at each stride, bits of the latent per point."""
        names = ("loss", "bits_stride_4", "bits_stride_2", "bits_stride_1", "bpp")
        values = (loss.total, *loss.cross_entropies, loss.bpp)
        return {name: float(value) for name, value in zip(names, values, strict=True)}

"""Training of PCGCv2: the rate-distortion loss and the optimiser step.

The loss at a rate is ``lmbda * D + R``, divided by the square root of lmbda so that no rate
dominates. R is the number of bits of the latent per point. D is a sum over the scales: the mean
binary cross entropy of the candidate voxels in bits, multiplied by a weight. The weight is
proportional to the side of the voxels, since a voxel that is lost at stride 4 cannot be recovered;
the authors weight all scales equally. Uniform noise replaces rounding. In training, a scale keeps
both the occupied voxels and the voxels that the network selects.
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

from pcc_networks.gains import parameter_groups
from pcc_networks.pcgcv2.model import SCALES, PCGCv2
from pcc_networks.sparse.thread_pool import ThreadPool
from pcc_networks.sparse.voxels import (
    CHILDREN,
    Keys,
    VoxelSet,
    kept_children,
    keys_of_slots,
    pyramid,
    selected_children,
)
from pcc_networks.training.loop import BaseTrainer, join_clouds
from pcc_networks.training.settings import MultiRateTraining

SCALE_WEIGHTS = tuple(SCALES * side / 7 for side in (4.0, 2.0, 1.0))
"""Weights of strides 4, 2 and 1 in the loss, with the same sum as the authors' weights."""


class Pcgcv2Loss(NamedTuple):
    """The loss of a step, and the terms of which it consists."""

    total: Tensor  # minimised
    cross_entropies: tuple[Tensor, ...]  # mean bits of a candidate voxel at strides 4, 2 and 1
    bpp: Tensor  # bits of the latent per point


def rate_distortion_loss(
    model: PCGCv2, keys: Keys, rate: int, lmbda: float, pool: ThreadPool, noise: torch.Generator
) -> Pcgcv2Loss:
    """Compute the loss of a cloud at one rate.

    Parameters
    ----------
    model
        The network.
    keys
        Sorted Morton keys (n,) of the voxels.
    rate
        Index of the rate.
    lmbda
        Lagrangian weight of the distortion.
    pool
        Threads of the convolutions.
    noise
        Source of the uniform noise that replaces rounding.
    """
    device = model.log_gains.device
    sets, child_maps = pyramid(keys, SCALES, pool)
    scaled = model.g_a(sets, child_maps, pool) * model.gain(rate)
    y_hat = scaled + torch.rand(scaled.shape, generator=noise).to(device) - 0.5
    bits = -model.entropy_bottleneck(rate).likelihood(y_hat).log2().sum()
    cross_entropies = _cross_entropies(model, y_hat / model.gain(rate), sets, pool)
    bpp = bits / len(keys)
    distortion = torch.stack(cross_entropies) @ torch.tensor(SCALE_WEIGHTS, device=device)
    total = (lmbda * distortion + bpp) / math.sqrt(lmbda)
    return Pcgcv2Loss(total, tuple(cross_entropies), bpp)


def _cross_entropies(
    model: PCGCv2, features: Tensor, sets: list[VoxelSet], pool: ThreadPool
) -> list[Tensor]:
    cross_entropies, parents = [], sets[SCALES]
    for scale in range(SCALES):
        children, logits = model.g_s.scale(scale)(features, parents, pool)
        occupied_keys = sets[SCALES - 1 - scale].keys
        occupied = _occupied(parents, occupied_keys)
        target = torch.from_numpy(occupied).to(logits)
        cross_entropies.append(
            binary_cross_entropy_with_logits(logits.reshape(-1), target) / math.log(2)
        )
        if scale + 1 < SCALES:
            selected = kept_children(logits.detach().cpu().numpy(), len(occupied_keys))
            kept = np.union1d(selected, np.flatnonzero(occupied))
            features = children.flatten(0, 1)[torch.from_numpy(kept).to(features.device)]
            parents = selected_children(parents, kept, pool)
    return cross_entropies


def _occupied(parents: VoxelSet, occupied_keys: Keys) -> NDArray[np.bool_]:
    candidates = keys_of_slots(parents.keys, np.arange(CHILDREN * len(parents)))
    nearest = np.minimum(np.searchsorted(occupied_keys, candidates), len(occupied_keys) - 1)
    occupied: NDArray[np.bool_] = occupied_keys[nearest] == candidates
    return occupied


class Pcgcv2Trainer(BaseTrainer[PCGCv2, Pcgcv2Loss]):
    """Trains PCGCv2; each step is at a random rate."""

    training: MultiRateTraining

    def __init__(self, model: PCGCv2, training: MultiRateTraining, pool: ThreadPool) -> None:
        super().__init__(model, training, parameter_groups(model))
        self.pool = pool

    def step(self, clouds: Sequence[Keys]) -> Pcgcv2Loss:
        """Do one step of the optimiser at a random rate, and return the loss."""
        rate = int(torch.randint(len(self.training.lmbdas), (1,), generator=self.noise))
        lmbda = self.training.lmbdas[rate]
        keys = join_clouds(clouds)
        loss = rate_distortion_loss(self.model, keys, rate, lmbda, self.pool, self.noise)
        self.optimiser_step(loss.total)
        cross_entropies = tuple(value.detach() for value in loss.cross_entropies)
        return Pcgcv2Loss(loss.total.detach(), cross_entropies, loss.bpp.detach())

    def row(self, loss: Pcgcv2Loss) -> dict[str, float]:
        """Return the loss of a step and its terms as a row of the training curve."""
        names = ("loss", "bits_stride_4", "bits_stride_2", "bits_stride_1", "bpp")
        values = (loss.total, *loss.cross_entropies, loss.bpp)
        return {name: float(value) for name, value in zip(names, values, strict=True)}

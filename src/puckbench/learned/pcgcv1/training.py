"""Training of PCGCv1: its rate-distortion loss, and one step.

The loss of a batch at a rate is ``lambda * D + R``, divided by the square root of lambda so that no
rate outweighs the others where they share weights. R is the bits of latent and hyper-latent per
point. D is ``beta * cross entropy of empty voxels + cross entropy of occupied ones``, each the mean
over its voxels, in nats, as in the paper (empty voxels of blocks that the decoder knows to be empty
do not count). Rounding is replaced by uniform noise, and at first the rate has a small weight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, max_pool3d, softplus

from puckbench.learned.gains import parameter_groups
from puckbench.learned.pcgcv1.laplace import likelihood
from puckbench.learned.pcgcv1.model import PCGCv1, coded_blocks
from puckbench.learned.pcgcv1.occupied_blocks import STRIDE
from puckbench.learned.pcgcv1.training_settings import Pcgcv1Training
from puckbench.learned.sparse.voxels import Keys, morton_voxels
from puckbench.learned.training.loop import BaseTrainer

BETA = 3.0
_MIN_RATE_WEIGHT = 0.01


class Pcgcv1Loss(NamedTuple):
    """The loss of a batch.

    Parameters
    ----------
    total
        What is minimised.
    empty, occupied
        Mean cross entropies of empty and of occupied voxels.
    bpp, hyper_bpp
        Bits per point of the latent and of the hyper-latent.
    """

    total: Tensor
    empty: Tensor
    occupied: Tensor
    bpp: Tensor
    hyper_bpp: Tensor


def rate_distortion_loss(
    model: PCGCv1, x: Tensor, rate: int, lmbda: float, noise: torch.Generator,
    beta: float = BETA, rate_weight: float = 1.0,
) -> Pcgcv1Loss:  # fmt: skip
    """The loss at a rate of cubes x (n, 1, size, size, size) of zeros and ones, not all zero."""
    blocks = coded_blocks(model.shape, x)
    hyper_blocks = max_pool3d(blocks, 2)
    y = model.g_a(x) * model.gain(rate) * blocks
    z_hat = _noisy(model.h_a(y), noise) * hyper_blocks
    y_hat = _noisy(y, noise) * blocks
    y_likelihoods = likelihood(y_hat, *model.h_s(z_hat))
    rows = z_hat.movedim(1, -1).flatten(0, 3)[hyper_blocks.flatten() > 0]
    z_likelihoods = model.entropy_bottleneck(rate).likelihood(rows)
    points = x.sum()
    bpp = -(y_likelihoods.log2() * blocks).sum() / points
    hyper_bpp = -z_likelihoods.log2().sum() / points
    logits, full = model.g_s(y_hat / model.gain(rate)), x > 0
    free = (interpolate(blocks, scale_factor=STRIDE) > 0) & ~full
    empty = softplus(logits[free]).sum() / free.sum().clamp_min(1)
    occupied = softplus(-logits[full]).mean()
    total = (lmbda * (beta * empty + occupied) + rate_weight * (bpp + hyper_bpp)) / math.sqrt(lmbda)
    return Pcgcv1Loss(total, empty, occupied, bpp, hyper_bpp)


def _noisy(values: Tensor, noise: torch.Generator) -> Tensor:
    return values + torch.rand(values.shape, generator=noise).to(values.device) - 0.5


def dense_cubes(clouds: Sequence[Keys], size: int) -> Tensor:
    """Cubes of voxels in Morton order as zeros and ones (n, 1, size, size, size)."""
    cubes = np.zeros((len(clouds), 1, size, size, size), dtype=np.float32)
    for cube, keys in zip(cubes[:, 0], clouds, strict=True):
        cube[tuple(morton_voxels(keys).T)] = 1
    return torch.from_numpy(cubes)


class Pcgcv1Trainer(BaseTrainer[PCGCv1, Pcgcv1Loss]):
    """PCGCv1 in training, each step at a rate drawn at random."""

    training: Pcgcv1Training

    def __init__(self, model: PCGCv1, training: Pcgcv1Training) -> None:
        # the memory layout in which a CPU's convolutions are fast, forwards and backwards
        ordered = model.to(memory_format=torch.channels_last_3d)  # type: ignore[call-overload]
        super().__init__(ordered, training, parameter_groups(model))

    def step(self, clouds: Sequence[Keys]) -> Pcgcv1Loss:
        """One step on a batch of cubes."""
        cubes = dense_cubes(clouds, self.training.cube_size).to(self.model.log_gains.device)
        rate = int(torch.randint(len(self.training.lmbdas), (1,), generator=self.noise))
        x = cubes.to(memory_format=torch.channels_last_3d)
        lmbda, rate_weight = self.training.lmbdas[rate], self.rate_weight()
        loss = rate_distortion_loss(self.model, x, rate, lmbda, self.noise, rate_weight=rate_weight)
        self.optimiser_step(loss.total)
        return Pcgcv1Loss(*(value.detach() for value in loss))

    def rate_weight(self) -> float:
        """The weight of the rate in the loss: it grows from a hundredth to one."""
        warm_up = self.training.rate_warm_up * self.training.steps
        return float(_MIN_RATE_WEIGHT ** max(0.0, 1 - self.done / warm_up))

    def row(self, loss: Pcgcv1Loss) -> dict[str, float]:
        """The loss and its parts."""
        return {name: float(value) for name, value in loss._asdict().items()}

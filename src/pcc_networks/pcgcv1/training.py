"""Training of PCGCv1: the rate-distortion loss and the optimiser step.

The loss at a rate is ``lmbda * D + R``, divided by the square root of lmbda so that no rate
dominates. R is the bits of latent and hyper-latent per point; D (as in the paper) is ``beta * cross
entropy of empty voxels + cross entropy of occupied voxels``. Cross entropies are means in nats,
without voxels that the decoder knows to be empty. Uniform noise replaces rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, max_pool3d, softplus

from pcc_networks.gains import parameter_groups
from pcc_networks.pcgcv1.laplace import likelihood
from pcc_networks.pcgcv1.model import PCGCv1, coded_blocks
from pcc_networks.pcgcv1.occupied_blocks import STRIDE
from pcc_networks.pcgcv1.training_settings import Pcgcv1Training
from pcc_networks.sparse.voxels import Keys, morton_voxels
from pcc_networks.training.loop import BaseTrainer

BETA = 3.0
_MIN_RATE_WEIGHT = 0.01


class Pcgcv1Loss(NamedTuple):
    total: Tensor  # minimised
    empty: Tensor  # mean cross entropy of empty voxels
    occupied: Tensor  # mean cross entropy of occupied voxels
    bpp: Tensor  # bits of the latent per point
    hyper_bpp: Tensor  # bits of the hyper-latent per point


def rate_distortion_loss(
    model: PCGCv1, x: Tensor, rate: int, lmbda: float, noise: torch.Generator,
    beta: float = BETA, rate_weight: float = 1.0,
) -> Pcgcv1Loss:  # fmt: skip
    blocks = coded_blocks(model.shape, x)
    hyper_blocks = max_pool3d(blocks, 2)
    y = model.g_a(x) * model.gain(rate) * blocks
    z_hat = _with_noise(model.h_a(y), noise) * hyper_blocks
    y_hat = _with_noise(y, noise) * blocks
    y_likelihoods = likelihood(y_hat, *model.h_s(z_hat))
    z_rows = z_hat.movedim(1, -1).flatten(0, 3)[hyper_blocks.flatten() > 0]
    z_likelihoods = model.entropy_bottleneck(rate).likelihood(z_rows)
    points = x.sum()
    bpp = -(y_likelihoods.log2() * blocks).sum() / points
    hyper_bpp = -z_likelihoods.log2().sum() / points
    logits, is_occupied = model.g_s(y_hat / model.gain(rate)), x > 0
    is_empty = (interpolate(blocks, scale_factor=STRIDE) > 0) & ~is_occupied
    empty = softplus(logits[is_empty]).sum() / is_empty.sum().clamp_min(1)
    occupied = softplus(-logits[is_occupied]).mean()
    total = (lmbda * (beta * empty + occupied) + rate_weight * (bpp + hyper_bpp)) / math.sqrt(lmbda)
    return Pcgcv1Loss(total, empty, occupied, bpp, hyper_bpp)


def _with_noise(values: Tensor, noise: torch.Generator) -> Tensor:
    return values + torch.rand(values.shape, generator=noise).to(values.device) - 0.5


def dense_cubes(clouds: Sequence[Keys], size: int) -> Tensor:
    cubes = np.zeros((len(clouds), 1, size, size, size), dtype=np.float32)
    for cube, keys in zip(cubes[:, 0], clouds, strict=True):
        cube[tuple(morton_voxels(keys).T)] = 1
    return torch.from_numpy(cubes)


class Pcgcv1Trainer(BaseTrainer[PCGCv1, Pcgcv1Loss]):
    training: Pcgcv1Training

    def __init__(self, model: PCGCv1, training: Pcgcv1Training) -> None:
        # channels-last memory, in which convolutions on a CPU are fast
        ordered = model.to(memory_format=torch.channels_last_3d)  # type: ignore[call-overload]
        super().__init__(ordered, training, parameter_groups(model))

    def step(self, clouds: Sequence[Keys]) -> Pcgcv1Loss:
        cubes = dense_cubes(clouds, self.training.cube_size).to(self.model.log_gains.device)
        rate = int(torch.randint(len(self.training.lmbdas), (1,), generator=self.noise))
        x = cubes.to(memory_format=torch.channels_last_3d)
        lmbda, rate_weight = self.training.lmbdas[rate], self.rate_weight()
        loss = rate_distortion_loss(self.model, x, rate, lmbda, self.noise, rate_weight=rate_weight)
        self.optimiser_step(loss.total)
        return Pcgcv1Loss(*(value.detach() for value in loss))

    def rate_weight(self) -> float:
        warm_up = self.training.rate_warm_up * self.training.steps
        return float(_MIN_RATE_WEIGHT ** max(0.0, 1 - self.done / warm_up))

    def row(self, loss: Pcgcv1Loss) -> dict[str, float]:
        return {name: float(value) for name, value in loss._asdict().items()}

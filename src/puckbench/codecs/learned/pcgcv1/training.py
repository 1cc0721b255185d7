"""Training PCGCv1: its loss, and one step.

The loss of cubes at a rate is ``alpha * (beta * cross entropy of empty voxels + cross entropy of
occupied ones) + bits per point of the latent and of the hyper-latent``, each cross entropy the mean
over its voxels, in nats, as the original has it (empty voxels of blocks that the decoder knows to
be empty do not count); divided by the square root of alpha so that no
rate outweighs the others where they share weights. While training, rounding is uniform noise, and
at first the bits count little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, max_pool3d, softplus

from puckbench.codecs.learned.gains import parameter_groups
from puckbench.codecs.learned.pcgcv1.laplace import likelihood
from puckbench.codecs.learned.pcgcv1.model import PCGCv1, held
from puckbench.codecs.learned.pcgcv1.occupied_blocks import STRIDE
from puckbench.codecs.learned.pcgcv1.training_settings import Training
from puckbench.codecs.learned.sparse.voxels import Keys, morton_voxels
from puckbench.codecs.learned.training.loop import Trainer as AnyTrainer

BETA = 3.0
_LEAST_PRICE = 0.01


class Loss(NamedTuple):
    """What a batch costs.

    empty, occupied: mean cross entropies. bpp: bits per point of the latent; hyper_bpp: of the
    hyper-latent.
    """

    total: Tensor
    empty: Tensor
    occupied: Tensor
    bpp: Tensor
    hyper_bpp: Tensor


def loss_of(
    model: PCGCv1, cubes: Tensor, rate: int, alpha: float, noise: torch.Generator,
    beta: float = BETA, price: float = 1.0,
) -> Loss:  # fmt: skip
    """The loss at a rate of cubes (n, 1, side, side, side) of zeros and ones, not all empty.

    price: weight of the bits.
    """
    blocks = held(model.shape, cubes)
    eights = max_pool3d(blocks, 2)
    latent = model.analysis(cubes) * model.gain(rate) * blocks
    hyper = _noisy(model.hyper_encoder(latent), noise) * eights
    noisy = _noisy(latent, noise) * blocks
    masses = likelihood(noisy, *model.hyper_decoder(hyper))
    rows = hyper.movedim(1, -1).flatten(0, 3)[eights.flatten() > 0]
    hyper_masses = model.bottleneck(rate).likelihood(rows)
    points = cubes.sum()
    bpp = -(masses.log2() * blocks).sum() / points
    hyper_bpp = -hyper_masses.log2().sum() / points
    logits, full = model.synthesis(noisy / model.gain(rate)), cubes > 0
    free = (interpolate(blocks, scale_factor=STRIDE) > 0) & ~full
    empty = softplus(logits[free]).sum() / free.sum().clamp_min(1)
    occupied = softplus(-logits[full]).mean()
    total = (alpha * (beta * empty + occupied) + price * (bpp + hyper_bpp)) / math.sqrt(alpha)
    return Loss(total, empty, occupied, bpp, hyper_bpp)


def _noisy(values: Tensor, noise: torch.Generator) -> Tensor:
    return values + torch.rand(values.shape, generator=noise).to(values.device) - 0.5


def dense(clouds: Sequence[Keys], side: int) -> Tensor:
    """Cubes of voxels in Morton order as zeros and ones (n, 1, side, side, side)."""
    cubes = np.zeros((len(clouds), 1, side, side, side), dtype=np.float32)
    for cube, keys in zip(cubes[:, 0], clouds, strict=True):
        cube[tuple(morton_voxels(keys).T)] = 1
    return torch.from_numpy(cubes)


class Trainer(AnyTrainer[PCGCv1, Loss]):
    """PCGCv1 in training, at all its rates in turn."""

    training: Training

    def __init__(self, model: PCGCv1, training: Training) -> None:
        # the layout in which a processor's convolutions are fast, forwards and backwards
        laid = model.to(memory_format=torch.channels_last_3d)  # type: ignore[call-overload]
        super().__init__(laid, training, parameter_groups(model))

    def step(self, clouds: Sequence[Keys]) -> Loss:
        """One step on a batch of cubes, at the rate whose turn it is."""
        cubes = dense(clouds, self.training.side).to(self.model.log_gains.device)
        rate = int(torch.randint(len(self.training.alphas), (1,), generator=self.noise))
        laid = cubes.to(memory_format=torch.channels_last_3d)
        alpha = self.training.alphas[rate]
        loss = loss_of(self.model, laid, rate, alpha, self.noise, price=self.price())
        self.descend(loss.total)
        return Loss(*(value.detach() for value in loss))

    def price(self) -> float:
        """The weight of the bits, from a hundredth to one."""
        eased = self.training.eased * self.training.steps
        return float(_LEAST_PRICE ** max(0.0, 1 - self.done / eased))

    def row(self, loss: Loss) -> dict[str, float]:
        """The loss and its parts."""
        return {name: float(value) for name, value in loss._asdict().items()}

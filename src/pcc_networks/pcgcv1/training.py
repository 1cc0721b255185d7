"""Training of PCGCv1: initial weights, the rate-distortion loss, and the optimiser step.

With PyTorch's initial weights, the latent has a standard deviation of 0.05. This is far below the
noise that replaces rounding, and the network does not learn. Therefore the weights of each layer in
turn are divided by the standard deviation of the layer's output for an example (layer-sequential
unit-variance initialisation).

The loss at a rate is ``lmbda * D + R``, divided by the square root of lmbda so that no rate
dominates. R is the number of bits of latent and hyper-latent per point. D is, as in the paper,
``beta * cross entropy of empty voxels + cross entropy of occupied voxels``. Cross entropies are
means in nats. They leave out voxels that the decoder knows to be empty. Uniform noise replaces
rounding.

References
----------
Mishkin, Matas: "All you need is a good init", ICLR 2016.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, softplus

from pcc_networks.gains import parameter_groups
from pcc_networks.pcgcv1.cubes import STRIDE
from pcc_networks.pcgcv1.hyper_prior import likelihood
from pcc_networks.pcgcv1.model import PCGCv1
from pcc_networks.sparse.voxels import Keys, morton_voxels
from pcc_networks.training.loop import BaseTrainer
from pcc_networks.training.settings import Pcgcv1Training

_DEVIATIONS = {"conv1_2": 0.3, "conv2_3": 0.3, "g_a.conv_out": 4.0, "h_a.conv3": 3.0,
               "g_s.conv_out": 0.5}  # fmt: skip
"""Standard deviations other than one: of residuals, of values to be rounded, and of logits."""
_EMPTY_PER_OCCUPIED = 3.0
"""Empty voxels per occupied voxel according to the initial logits."""


def initialise(model: PCGCv1, cube_size: int) -> None:
    """Scale the weights of a new model, so that each layer's output for a sphere has unit variance.

    Some layers, which are listed in `_DEVIATIONS`, get another standard deviation.
    """
    with torch.no_grad(), _rescaled(model):
        y = model.g_a(sphere(cube_size))
        model.h_s(model.h_a(y))
        model.g_s(y)
        if model.g_s.conv_out.bias is not None:
            model.g_s.conv_out.bias.fill_(-math.log(_EMPTY_PER_OCCUPIED))


def sphere(size: int) -> Tensor:
    """Return the occupancy (1, 1, size, size, size) of a sphere in a cube."""
    axis = torch.arange(size) - (size - 1) / 2
    radius = (axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2).sqrt()
    return ((radius - 0.4 * size).abs() < 0.5).float()[None, None]


@contextmanager
def _rescaled(model: nn.Module) -> Iterator[None]:
    hooks = [
        layer.register_forward_hook(_rescaler(name))
        for name, layer in model.named_modules()
        if isinstance(layer, (nn.Conv3d, nn.ConvTranspose3d))
    ]
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()


def _rescaler(name: str) -> Callable[[Any, Any, Tensor], Tensor]:
    deviation = next((d for end, d in _DEVIATIONS.items() if name.endswith(end)), 1.0)

    def rescale(layer: nn.Conv3d, _: Any, output: Tensor) -> Tensor:
        if layer.bias is not None:
            bias = layer.bias[:, None, None, None]
            output = output - bias
            layer.bias.zero_()
        factor = deviation / output.std().clamp_min(1e-6)
        layer.weight.mul_(factor)
        return output * factor

    return rescale


BETA = 3.0
_MIN_RATE_WEIGHT = 0.01


class Pcgcv1Loss(NamedTuple):
    """The loss of a step, and the terms of which it consists."""

    total: Tensor  # minimised
    empty: Tensor  # mean cross entropy of empty voxels
    occupied: Tensor  # mean cross entropy of occupied voxels
    bpp: Tensor  # bits of the latent per point
    hyper_bpp: Tensor  # bits of the hyper-latent per point


def rate_distortion_loss(
    model: PCGCv1, x: Tensor, rate: int, lmbda: float, noise: torch.Generator,
    beta: float = BETA, rate_weight: float = 1.0,
) -> Pcgcv1Loss:  # fmt: skip
    """Compute the loss of cubes at one rate.

    Parameters
    ----------
    model
        The network.
    x
        Occupancy (n, 1, size, size, size) of the cubes, 0 or 1.
    rate
        Index of the rate.
    lmbda
        Lagrangian weight of the distortion.
    noise
        Source of the uniform noise that replaces rounding.
    beta
        Weight of empty voxels in the distortion.
    rate_weight
        Weight of the bits, below 1 at the start of a training.
    """
    y, z, blocks, hyper_blocks = model.latents(x, rate)
    z_hat = _with_noise(z, noise) * hyper_blocks
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
    """Return the occupancy (n, 1, size, size, size) of clouds that are given by Morton keys."""
    cubes = np.zeros((len(clouds), 1, size, size, size), dtype=np.float32)
    for cube, keys in zip(cubes[:, 0], clouds, strict=True):
        cube[tuple(morton_voxels(keys).T)] = 1
    return torch.from_numpy(cubes)


class Pcgcv1Trainer(BaseTrainer[PCGCv1, Pcgcv1Loss]):
    """Trains PCGCv1; each step is at a random rate."""

    training: Pcgcv1Training

    def __init__(self, model: PCGCv1, training: Pcgcv1Training) -> None:
        # channels-last memory, in which convolutions on a CPU are fast
        ordered = model.to(memory_format=torch.channels_last_3d)  # type: ignore[call-overload]
        super().__init__(ordered, training, parameter_groups(model))

    def step(self, clouds: Sequence[Keys]) -> Pcgcv1Loss:
        """Do one step of the optimiser at a random rate, and return the loss."""
        cubes = dense_cubes(clouds, self.training.cube_size).to(self.model.log_gains.device)
        rate = int(torch.randint(len(self.training.lmbdas), (1,), generator=self.noise))
        x = cubes.to(memory_format=torch.channels_last_3d)
        lmbda, rate_weight = self.training.lmbdas[rate], self.rate_weight()
        loss = rate_distortion_loss(self.model, x, rate, lmbda, self.noise, rate_weight=rate_weight)
        self.optimiser_step(loss.total)
        return Pcgcv1Loss(*(value.detach() for value in loss))

    def rate_weight(self) -> float:
        """Return the weight of the bits in the loss of the next step."""
        warm_up = self.training.rate_warm_up * self.training.steps
        return float(_MIN_RATE_WEIGHT ** max(0.0, 1 - self.done / warm_up))

    def row(self, loss: Pcgcv1Loss) -> dict[str, float]:
        """Return the loss of a step and its terms as a row of the training curve."""
        return {name: float(value) for name, value in loss._asdict().items()}

"""Training PCGCv1: its loss and one step, for one rate or for several with one set of weights.

The loss of cubes at a rate is ``alpha * (beta * cross entropy of empty voxels + cross entropy of
occupied ones) + bits per point of the latent and of the hyper-latent``, each cross entropy the mean
over its voxels, in nats, as the original has it. While training, rounding is uniform noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import softplus

from puckbench.codecs.pcgcv1.laplace import likelihood
from puckbench.codecs.pcgcv1.model import PCGCv1
from puckbench.errors import InputError

BETA = 3.0


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


def spread_gains(model: PCGCv1, alphas: Sequence[float]) -> None:
    """Start the gains where fine rates have fine steps: by the square root of alpha."""
    if len(alphas) != model.shape.rates:
        raise InputError("the model has another number of rates than the training")
    with torch.no_grad():
        for rate, alpha in enumerate(alphas):
            model.log_gains[rate] = 0.5 * math.log(alpha / max(alphas))


def loss_of(
    model: PCGCv1, cubes: Tensor, rate: int, alpha: float, noise: torch.Generator,
    beta: float = BETA,
) -> Loss:  # fmt: skip
    """The loss at a rate of cubes (n, 1, side, side, side) of zeros and ones, not all empty."""
    latent = model.analysis(cubes) * model.gain(rate)
    hyper = _noisy(model.hyper_encoder(latent), noise)
    noisy = _noisy(latent, noise)
    masses = likelihood(noisy, *model.hyper_decoder(hyper))
    hyper_masses = model.bottleneck(rate).likelihood(hyper.movedim(1, -1).flatten(0, 3))
    points = cubes.sum()
    bpp, hyper_bpp = -masses.log2().sum() / points, -hyper_masses.log2().sum() / points
    logits, full = model.synthesis(noisy / model.gain(rate)), cubes > 0
    empty, occupied = softplus(logits[~full]).mean(), softplus(-logits[full]).mean()
    total = alpha * (beta * empty + occupied) + bpp + hyper_bpp
    return Loss(total, empty, occupied, bpp, hyper_bpp)


def _noisy(values: Tensor, noise: torch.Generator) -> Tensor:
    return values + torch.rand(values.shape, generator=noise).to(values.device) - 0.5


def step(
    model: PCGCv1, optimiser: torch.optim.Optimizer, cubes: Tensor, alphas: Sequence[float],
    noise: torch.Generator,
) -> Loss:  # fmt: skip
    """One step on a batch of cubes, at a rate drawn from `noise`."""
    rate = int(torch.randint(len(alphas), (1,), generator=noise))
    optimiser.zero_grad(set_to_none=True)
    loss = loss_of(model, cubes, rate, alphas[rate], noise)
    loss.total.backward()  # type: ignore[no-untyped-call]
    optimiser.step()
    return Loss(*(value.detach() for value in loss))

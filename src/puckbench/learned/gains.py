"""One network for several rates: gains of the latent, and an entropy bottleneck for each rate.

The latent is multiplied by a gain for each rate and channel before it is rounded, and divided by it
after, so that one set of weights serves a whole rate-distortion curve.

References
----------
Cui, Wang, Gao et al.: "Asymmetric Gained Deep Image Compression With Continuous Rate Adaptation",
CVPR 2021.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol, cast

import torch
from torch import Tensor, nn

from puckbench.core.errors import InputError
from puckbench.learned.entropy_bottleneck import EntropyBottleneck

_OWN_LR_FACTOR = 5.0


class MultiRateShape(Protocol):
    """Sizes of a network that codes at several rates."""

    @property
    def rates(self) -> int:
        """How many rates it has."""

    @property
    def latent_channels(self) -> int:
        """Channels of the latent."""

    def model_dump(self) -> dict[str, Any]:
        """The sizes by name."""


class MultiRateNetwork(nn.Module):
    """A network with entropy bottlenecks and gains, which a subclass adds after its layers."""

    shape: MultiRateShape
    entropy_bottlenecks: nn.ModuleList
    log_gains: nn.Parameter

    def __init__(self, shape: Any) -> None:
        super().__init__()
        self.shape = shape

    def add_rates(self, bottleneck_channels: int) -> None:
        """Add an entropy bottleneck and gains of one for each rate."""
        rates = self.shape.rates
        self.entropy_bottlenecks = nn.ModuleList(
            EntropyBottleneck(bottleneck_channels) for _ in range(rates)
        )
        self.log_gains = nn.Parameter(torch.zeros(rates, self.shape.latent_channels))

    def entropy_bottleneck(self, rate: int) -> EntropyBottleneck:
        """The factorised entropy model of a rate."""
        return cast(EntropyBottleneck, self.entropy_bottlenecks[rate])

    def gain(self, rate: int) -> Tensor:
        """What the latent's channels are multiplied by, (latent_channels,)."""
        return self.log_gains[rate].exp()


def parameter_groups(model: MultiRateNetwork) -> list[dict[str, Any]]:
    """Parameter groups of an optimiser; those of one rate alone, seldom trained, learn faster."""
    own = [model.log_gains, *model.entropy_bottlenecks.parameters()]
    known = set(map(id, own))
    shared = [value for value in model.parameters() if id(value) not in known]
    return [{"params": shared, "lr_factor": 1.0}, {"params": own, "lr_factor": _OWN_LR_FACTOR}]


def initialise_gains(model: MultiRateNetwork, lmbdas: Sequence[float]) -> None:
    """Set the gains to the square roots of lambda, relative to the largest: finer steps for more.

    Raises
    ------
    InputError
        The model has another number of rates.
    """
    if len(lmbdas) != model.shape.rates:
        raise InputError("the model has another number of rates than the training")
    with torch.no_grad():
        for rate, lmbda in enumerate(lmbdas):
            model.log_gains[rate] = 0.5 * math.log(lmbda / max(lmbdas))

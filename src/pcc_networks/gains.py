"""Networks that serve several rates, with gains and an entropy bottleneck for each rate.

The latent is multiplied by the gains of a rate before it is rounded, and divided by them
afterwards.

References
----------
Cui et al.: "Asymmetric Gained Deep Image Compression With Continuous Rate Adaptation", CVPR 2021.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, cast

import torch
from torch import Tensor, nn

from pcc_networks.entropy_bottleneck import EntropyBottleneck
from pointkit.errors import InputError
from pointkit.models import Model

_RATE_LR_FACTOR = 5.0


class MultiRateNetwork(nn.Module):
    """Base class of networks for several rates.

    A subclass defines its layers, and then calls `add_rates`.
    """

    Shape: ClassVar[type[Model]]
    shape: Any
    entropy_bottlenecks: nn.ModuleList
    log_gains: nn.Parameter

    def __init__(self, shape: Any) -> None:
        super().__init__()
        self.shape = shape

    def add_rates(self, bottleneck_channels: int) -> None:
        """Create the gains and the entropy bottlenecks of all rates."""
        rates = self.shape.rates
        self.entropy_bottlenecks = nn.ModuleList(
            EntropyBottleneck(bottleneck_channels) for _ in range(rates)
        )
        self.log_gains = nn.Parameter(torch.zeros(rates, self.shape.latent_channels))

    def entropy_bottleneck(self, rate: int) -> EntropyBottleneck:
        """Return the entropy bottleneck of the rate with this index."""
        return cast(EntropyBottleneck, self.entropy_bottlenecks[rate])

    def gain(self, rate: int) -> Tensor:
        """Return the factors of the latent (channels,) at the rate with this index."""
        return self.log_gains[rate].exp()


def parameter_groups(model: MultiRateNetwork) -> list[dict[str, Any]]:
    """Return the parameter groups of an optimiser, in which gains and bottlenecks learn faster."""
    of_rates = [model.log_gains, *model.entropy_bottlenecks.parameters()]
    ids = set(map(id, of_rates))
    shared = [value for value in model.parameters() if id(value) not in ids]
    return [
        {"params": shared, "lr_factor": 1.0},
        {"params": of_rates, "lr_factor": _RATE_LR_FACTOR},
    ]


def initialise_gains(model: MultiRateNetwork, lmbdas: Sequence[float]) -> None:
    """Set all gains of each rate to sqrt(lambda / largest lambda).

    Raises InputError if the model has not as many rates as `lmbdas`.
    """
    if len(lmbdas) != model.shape.rates:
        raise InputError("the model has another number of rates than the training")
    with torch.no_grad():
        for rate, lmbda in enumerate(lmbdas):
            model.log_gains[rate] = 0.5 * math.log(lmbda / max(lmbdas))

"""One network for several rates: gains of the latent, and a bottleneck for each rate.

The latent is multiplied by a gain for each rate and channel before it is rounded, and divided by
it after (Cui, Wang, Gao et al.: "Asymmetric Gained Deep Image Compression", CVPR 2021), so that one
set of weights serves a whole rate-distortion curve; each rate has a bottleneck of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol, cast

import torch
from torch import Tensor, nn

from puckbench.codecs.learned.entropy_bottleneck import Bottleneck
from puckbench.core.errors import InputError

_FASTER = 5.0


class RatedShape(Protocol):
    """Sizes of a network."""

    @property
    def rates(self) -> int:
        """How many rates it has."""

    @property
    def latent(self) -> int:
        """Features coded."""


class Gained(nn.Module):
    """A network with bottlenecks and gains, which a subclass adds when it has its layers."""

    shape: RatedShape
    bottlenecks: nn.ModuleList
    log_gains: nn.Parameter

    def add_rates(self, shape: RatedShape, coded: int) -> None:
        """Bottlenecks of `coded` channels, and gains of one."""
        self.bottlenecks = nn.ModuleList(Bottleneck(coded) for _ in range(shape.rates))
        self.log_gains = nn.Parameter(torch.zeros(shape.rates, shape.latent))

    def bottleneck(self, rate: int) -> Bottleneck:
        """The entropy model of a rate."""
        return cast(Bottleneck, self.bottlenecks[rate])

    def gain(self, rate: int) -> Tensor:
        """What the latent's channels are multiplied by, (latent); ones where there is one rate."""
        return self.log_gains[rate].exp()


def parameter_groups(model: Gained) -> list[dict[str, Any]]:
    """Parameters of one rate alone are seldom trained, and take larger steps."""
    own = [model.log_gains, *model.bottlenecks.parameters()]
    known = set(map(id, own))
    shared = [value for value in model.parameters() if id(value) not in known]
    return [{"params": shared, "faster": 1.0}, {"params": own, "faster": _FASTER}]


def spread_gains(model: Gained, alphas: Sequence[float]) -> None:
    """Start the gains where fine rates have fine steps: by the square root of alpha.

    InputError when the model has another number of rates.
    """
    if len(alphas) != model.shape.rates:
        raise InputError("the model has another number of rates than the training")
    with torch.no_grad():
        for rate, alpha in enumerate(alphas):
            model.log_gains[rate] = 0.5 * math.log(alpha / max(alphas))

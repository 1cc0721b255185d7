from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, PositiveFloat, PositiveInt

from pcc_networks.catalogue import PCGCV1
from pcc_networks.training.settings import Channels, Lmbdas, MultiRateTraining

if TYPE_CHECKING:
    from pcc_networks.pcgcv1.training import Pcgcv1Trainer


class Pcgcv1Training(MultiRateTraining):
    """Settings for training PCGCv1; `channels` are those of g_a at strides 1, 2 and 4.

    Cubes may be smaller than the codec's, since the network is convolutional.

    Parameters
    ----------
    rate_warm_up
        Fraction of the steps during which the rate's weight in the loss grows to 1; with weight 1
        from the start, the network learns not to use its latent.
    """

    network = PCGCV1
    batch_size: PositiveInt = 2
    cube_size: Annotated[int, Field(gt=0, multiple_of=8)] = 64
    lmbdas: Lmbdas = (0.75, 2.0, 3.5, 6.0, 10.0)
    channels: tuple[Channels, Channels, Channels] = (16, 32, 64)
    rate_warm_up: PositiveFloat = 0.5

    @contextmanager
    def trainer(self) -> Iterator[Pcgcv1Trainer]:
        import torch

        from pcc_networks.gains import initialise_gains
        from pcc_networks.pcgcv1.initialisation import initialise
        from pcc_networks.pcgcv1.model import PCGCv1, Pcgcv1Shape
        from pcc_networks.pcgcv1.training import Pcgcv1Trainer
        from pcc_networks.training.loop import on_device

        torch.manual_seed(self.seed)
        rates = len(self.lmbdas)
        model = PCGCv1(Pcgcv1Shape(channels=self.channels, rates=rates, occupied_blocks=True))
        initialise(model, self.cube_size)
        initialise_gains(model, self.lmbdas)
        yield Pcgcv1Trainer(on_device(model), self)

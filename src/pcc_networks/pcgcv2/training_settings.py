from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pcc_networks.catalogue import PCGCV2
from pcc_networks.training.settings import Channels, MultiRateTraining

if TYPE_CHECKING:
    from pcc_networks.pcgcv2.training import Pcgcv2Trainer


class Pcgcv2Training(MultiRateTraining):
    """Settings for training PCGCv2; `channels` are those of g_a at strides 1, 2, 4 and 8."""

    network = PCGCV2
    channels: tuple[Channels, Channels, Channels, Channels] = (16, 32, 64, 32)

    @contextmanager
    def trainer(self) -> Iterator[Pcgcv2Trainer]:
        import torch

        from pcc_networks.gains import initialise_gains
        from pcc_networks.pcgcv2.model import PCGCv2, Pcgcv2Shape
        from pcc_networks.pcgcv2.training import Pcgcv2Trainer
        from pcc_networks.sparse.thread_pool import thread_pool
        from pcc_networks.training.loop import on_device

        torch.manual_seed(self.seed)
        model = PCGCv2(Pcgcv2Shape(channels=self.channels, rates=len(self.lmbdas)))
        initialise_gains(model, self.lmbdas)
        with thread_pool() as pool:
            yield Pcgcv2Trainer(on_device(model), self, pool)

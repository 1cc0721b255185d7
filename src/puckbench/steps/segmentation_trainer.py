from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lidar_segmentation import SegmentationTraining
    from lidar_segmentation.network import SegmentationModule
    from lidar_segmentation.training import Example, Examples
    from pcc_networks.training.loop import BaseTrainer

CODE = ("pcc_networks.training", "pcc_networks.weights_file")


def segmentation_trainer(
    settings: SegmentationTraining, examples: Examples
) -> BaseTrainer[SegmentationModule, float]:
    """Return the trainer of a network of segmentation, with the checkpoints of codecs' trainings.

    Parameters
    ----------
    settings
        Settings of the training.
    examples
        The examples, which compute the loss.
    """
    from lidar_segmentation.network import SegmentationModule
    from pcc_networks.training.loop import BaseTrainer

    class Trainer(BaseTrainer[SegmentationModule, float]):
        max_gradient_norm = 5.0

        def step(self, batch: Sequence[Example]) -> float:
            loss = examples.loss(self.model, batch)
            self.optimiser_step(loss)
            return float(loss.detach())

        def row(self, loss: float) -> dict[str, float]:
            return {"loss": loss}

    return Trainer(settings.module().train(), settings)

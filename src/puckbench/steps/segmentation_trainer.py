from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pcc_networks.training.loop import BaseTrainer

if TYPE_CHECKING:
    from lidar_segmentation import SegmentationTraining
    from lidar_segmentation.network import SegmentationModule  # noqa: F401 (named in quotes)
    from lidar_segmentation.training import Example, Examples

CODE = ("pcc_networks.training",)


class SegmentationTrainer(BaseTrainer["SegmentationModule", float]):
    """Trains a network of segmentation, with checkpoints as the codecs' trainings have them.

    Parameters
    ----------
    settings
        Settings of the training.
    examples
        The examples, which compute the loss.
    """

    max_gradient_norm = 5.0

    def __init__(self, settings: SegmentationTraining, examples: Examples) -> None:
        super().__init__(settings.module().train(), settings)
        self.examples = examples

    def step(self, batch: Sequence[Example]) -> float:
        """Do one step of the optimiser on a batch, and return the loss."""
        loss = self.examples.loss(self.model, batch)
        self.optimiser_step(loss)
        return float(loss.detach())

    def row(self, loss: float) -> dict[str, float]:
        """Return the loss of a step as a row of the training curve."""
        return {"loss": loss}

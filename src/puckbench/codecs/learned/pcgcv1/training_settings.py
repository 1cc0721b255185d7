"""The settings of a training of PCGCv1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.codecs.learned.training.settings import TrainingByAlpha
from puckbench.core.errors import InputError

if TYPE_CHECKING:
    from puckbench.codecs.learned.pcgcv1.training import Trainer

_STRIDE = 8


@dataclass(frozen=True, kw_only=True)
class Training(TrainingByAlpha):
    """A training of PCGCv1. widths: at strides 1, 2 and 4.

    Cubes may be smaller than those that the codec cuts, since the network is convolutional. eased:
    share of the steps over which the bits' weight in the loss grows to one: a network that is
    charged for its latent before it has a use for it learns to do without.
    """

    cubes: int = 2
    alphas: tuple[float, ...] = (0.75, 2.0, 3.5, 6.0, 10.0)
    widths: tuple[int, int, int] = (16, 32, 64)
    eased: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.side % _STRIDE:
            raise InputError(f"training: side {self.side} is no multiple of {_STRIDE}")

    @contextmanager
    def trainer(self) -> Iterator[Trainer]:
        """A new model with its optimiser."""
        import torch

        from puckbench.codecs.learned.gains import spread_gains
        from puckbench.codecs.learned.pcgcv1.initialisation import level
        from puckbench.codecs.learned.pcgcv1.model import PCGCv1, Shape
        from puckbench.codecs.learned.pcgcv1.training import Trainer
        from puckbench.codecs.learned.training.loop import on_device

        torch.manual_seed(self.seed)
        model = PCGCv1(Shape(widths=self.widths, rates=len(self.alphas), supported=True))
        level(model, self.side)
        spread_gains(model, self.alphas)
        yield Trainer(on_device(model), self)

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write the model as a set of weights with its card."""
        from puckbench.codecs.learned.pcgcv1.weights import save_weights

        save_weights(path, model, self.alphas, card)

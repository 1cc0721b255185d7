"""The settings of a training of PCGCv2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.codecs.learned.training.settings import TrainingByAlpha

if TYPE_CHECKING:
    from puckbench.codecs.learned.pcgcv2.training import Trainer


@dataclass(frozen=True, kw_only=True)
class Training(TrainingByAlpha):
    """A training of PCGCv2. widths: at strides 1, 2, 4 and 8."""

    widths: tuple[int, int, int, int] = (16, 32, 64, 32)

    @contextmanager
    def trainer(self) -> Iterator[Trainer]:
        """A new model with its optimiser."""
        import torch

        from puckbench.codecs.learned.gains import spread_gains
        from puckbench.codecs.learned.pcgcv2.model import PCGCv2, Shape
        from puckbench.codecs.learned.pcgcv2.training import Trainer
        from puckbench.codecs.learned.sparse.thread_pool import crew
        from puckbench.codecs.learned.training.loop import on_device

        torch.manual_seed(self.seed)
        model = PCGCv2(Shape(widths=self.widths, rates=len(self.alphas)))
        spread_gains(model, self.alphas)
        with crew() as workers:
            yield Trainer(on_device(model), self, workers)

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write the model as a set of weights with its card."""
        from puckbench.codecs.learned.pcgcv2.weights import save_weights

        save_weights(path, model, self.alphas, card)

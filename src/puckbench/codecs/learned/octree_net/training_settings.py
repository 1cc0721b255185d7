"""The settings of a training of the learned octree coder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.codecs.learned.training.settings import Training as AnyTraining
from puckbench.core.errors import InputError

if TYPE_CHECKING:
    from puckbench.codecs.learned.octree_net.examples import Examples
    from puckbench.codecs.learned.octree_net.training import Trainer
    from puckbench.geometry.cloud import Floats


@dataclass(frozen=True, kw_only=True)
class Training(AnyTraining):
    """A training of the learned octree coder.

    side: a power of two. scales: of the grids that cubes are cut on, coarsest and finest. width:
    of the features. before: convolutions before a level's first group. symmetries: of a cube in
    which it may be met, all 48 or the 8 that keep what is upright so.
    """

    steps: int = 3000
    cubes: int = 2
    side: int = 128
    rate_first: float = 3e-3
    scales: tuple[float, float] = (0.1, 1.1)
    width: int = 32
    before: int = 1
    symmetries: int = 48

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.symmetries not in (8, 48):
            raise InputError(f"training: symmetries cannot be {self.symmetries}")

    @contextmanager
    def trainer(self) -> Iterator[Trainer]:
        """A new model with its optimiser."""
        import torch

        from puckbench.codecs.learned.octree_net.model import OctreeNet, Shape
        from puckbench.codecs.learned.octree_net.training import Trainer
        from puckbench.codecs.learned.sparse.thread_pool import crew
        from puckbench.codecs.learned.training.loop import on_device

        torch.manual_seed(self.seed)
        model = OctreeNet(Shape(self.width, self.before))
        with crew() as workers:
            yield Trainer(on_device(model), self, workers)

    def examples(self, clouds: Sequence[Floats]) -> Examples:
        """Cubes of clouds (n, 3) on grids of random steps."""
        from puckbench.codecs.learned.octree_net.examples import Examples

        coarsest, finest = self.scales
        return Examples(
            clouds, self.side, self.cubes, seed=self.seed, coarsest=coarsest, finest=finest,
            upright=self.symmetries == 8,
        )  # fmt: skip

    def state(self, kept: Mapping[str, Any]) -> Mapping[str, Any]:
        """Parameters from the whole numbers that a set keeps."""
        from puckbench.codecs.learned.octree_net.weights import real_state

        return real_state(kept)

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write the model as a set of weights with its card."""
        from puckbench.codecs.learned.octree_net.weights import save_weights

        save_weights(path, model, card)
